"""One hardware runs every filter that fits its shape, bit for bit as the engine."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from images import ROOMY, TOP, fitting, simulator

from kalmanhdl.arithmetic.division import TableNewton
from kalmanhdl.arithmetic.fixed import Overflow, Rounding
from kalmanhdl.design import Design
from kalmanhdl.errors import DesignError, FormatError, ScheduleError, VerificationError
from kalmanhdl.model.initial import two_point
from kalmanhdl.model.state_space import linear_model
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.programmable.build import bound
from kalmanhdl.programmable.verification import verify_images
from kalmanhdl.shape import Shape
from kalmanhdl.toolchain.simulators import Simulator


def radar(axes: int, **said) -> Design:
    """Constant velocity along some axes, each with its measured position."""
    model = linear_model(
        np.kron(np.eye(axes), [[1.0, 1.5], [0.0, 1.0]]),
        np.kron(np.eye(axes), [[1.0, 0.0]]),
        np.kron(np.diag(0.5 + np.arange(axes)), [[0.25, 0.5], [0.5, 1.0]]),
        np.eye(axes) * 9.0,
        initial=two_point(),
        measurement_range=[[-400.0, 400.0]] * axes,
    )
    return Design(name=f"radar_{axes}", model=model, **said)


def verified(images, steps, which=Simulator.CXXRTL, *, optimised=False):
    found = verify_images(simulator(which, optimised=optimised), TOP, images, steps)
    assert [one.steps for one in found] == [steps] * len(images)
    assert all(one.bits > 20 * steps for one in found)


def test_filters_of_several_algorithms_run_one_after_the_other():
    designs = (radar(2), radar(1, algorithm="joseph"), radar(2, algorithm="sequential"), radar(2))
    verified([bound(design, ROOMY) for design in designs], 120)


@settings(max_examples=3, deadline=None)
@given(st.integers(0, 999), st.integers(0, 999))
def test_random_filters_that_fit_are_the_engine(first, second):
    verified([fitting(first), fitting(second)], 60)


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(st.integers(0, 9999), st.integers(0, 9999))
def test_many_random_filters_that_fit_are_the_engine(first, second):
    verified([fitting(first), fitting(second)], 500, optimised=True)


@pytest.mark.parametrize("rounding", Rounding)
@pytest.mark.parametrize("overflow", Overflow)
def test_a_filter_keeps_its_own_rounding_and_overflow(rounding, overflow):
    numerics = FixedSpecification(width=11, rounding=rounding, overflow=overflow)
    verified([bound(radar(1, numerics=numerics), ROOMY)], 80)


@pytest.mark.slow
@pytest.mark.parametrize("which", [Simulator.CXXRTL, Simulator.ICARUS])
def test_two_filters_of_16_bits_agree_over_2000_steps(which):
    images = [bound(radar(2), ROOMY), bound(radar(1, algorithm="joseph"), ROOMY)]
    verified(images, 2000, which, optimised=True)


@settings(max_examples=5, deadline=None)
@given(st.data())
def test_a_wrong_number_of_the_model_is_found(data):
    image = bound(radar(1), ROOMY)
    numbers = [
        (file, place)
        for file, words in image.image.files.items()
        for place, word in enumerate(words)
        if abs(word) > 1
    ]
    file, place = data.draw(st.sampled_from(numbers))
    words = list(image.image.files[file])
    # The last bits of some are rounded away before anybody sees them.
    bits = abs(words[place]).bit_length()
    words[place] ^= 1 << data.draw(st.integers(bits // 2, bits - 1))
    files = {**image.image.files, file: tuple(words)}
    with pytest.raises(VerificationError):
        verified([replace(image, image=replace(image.image, files=files))], 200)


def test_a_wrong_row_is_found():
    image = bound(radar(1), ROOMY)
    rows = list(image.image.rows)
    rows[20], rows[21] = rows[21], rows[20]
    with pytest.raises(VerificationError):
        verified([replace(image, image=replace(image.image, rows=tuple(rows)))], 200)


def test_the_words_of_an_image_have_an_address_each():
    image = bound(radar(2), ROOMY).image
    addresses = [address for address, _ in image.words]
    assert len(set(addresses)) == len(addresses)
    assert addresses[-1] == 0
    assert all(0 <= word < 1 << ROOMY.word_width for _, word in image.words)


@pytest.mark.parametrize(
    ("shape", "design", "error", "message"),
    [
        (Shape(rows=64), radar(2), ScheduleError, r"takes 1\d\d rows of control, and the store has 64"),
        (Shape(words=16), radar(2), ScheduleError, r"add_0_a takes \d+ words, and it has 16: .* words = \d+"),
        (Shape(states=1), radar(1), DesignError, r"x\[1\] has no port, and the hardware has x\[0\]"),
        (Shape(measurements=1), radar(2), DesignError, r"z\[1\] has no port"),
        (
            Shape(operand_width=12),
            radar(1),
            FormatError,
            r"takes \d+ bits, and .* have 1[23]: .* operand_width \d+ bits more",
        ),
        (
            Shape(operand_width=13, word_width=27),
            radar(1, numerics=FixedSpecification(width=12, classes={"constant": 12}), algorithm="joseph"),
            FormatError,
            r"takes \d+ bits, and words have 27: .* word_width \d+ bits more",
        ),
        (
            Shape(),
            radar(1, numerics=FixedSpecification(division=TableNewton(index_bits=7, iterations=0))),
            DesignError,
            r'by a table of 2\^7, and the hardware has exact ones: use .* division = "radix2"',
        ),
        (Shape(), radar(1, algorithm="scheduled"), DesignError, "takes the operation Table"),
    ],
)
def test_a_filter_that_does_not_fit_is_refused(shape, design, error, message):
    with pytest.raises(error, match=message):
        bound(design, shape)
