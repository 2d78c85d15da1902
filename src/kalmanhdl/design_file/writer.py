"""A design as TOML text that loads to an equal design."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kalmanhdl.algorithm import Algorithm
from kalmanhdl.arithmetic.division import DivisionMethod, LongDivision
from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.design import Architecture, Design, Processor, Target
from kalmanhdl.errors import OutputError
from kalmanhdl.model.converted import ConvertedModel
from kalmanhdl.model.formulas import Formulas
from kalmanhdl.model.inputs import RunTimeInput
from kalmanhdl.model.model import Model
from kalmanhdl.model.multiple import MultipleModel
from kalmanhdl.model.nonlinear import NonlinearModel
from kalmanhdl.model.state_space import Initial, LinearModel
from kalmanhdl.model.varying import VaryingModel
from kalmanhdl.model.written import written
from kalmanhdl.numerics.choices import Form
from kalmanhdl.numerics.floating import FloatSpecification
from kalmanhdl.numerics.functions.method import FunctionMethod, Interpolation
from kalmanhdl.numerics.specification import FixedSpecification
from kalmanhdl.shape import Shape

Array = NDArray[np.float64]
Lines = list[str]


def dump(design: Design, path: str | Path) -> None:
    """Write a design file.

    Raises:
        OutputError: the file cannot be written.
    """
    try:
        Path(path).write_text(dumps(design), encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from None


def dumps(design: Design) -> str:
    """The text of a design file; ``loads`` of it gives the design, every number to the last bit.

    Motion models are written as the matrices they stand for, expressions as their values.
    """
    blocks = [
        [f"name = {_text(design.name)}"],
        *_model(design.model),
        _algorithm(design.algorithm),
        _numerics(design.numerics),
        _signals(design.numerics),
        _headroom(design.numerics),
        _hardware(design),
        _target(design.target),
    ]
    return "\n\n".join("\n".join(block) for block in blocks if block) + "\n"


def _model(model: Model) -> list[Lines]:
    if isinstance(model, MultipleModel):
        return _multiple(model)
    if isinstance(model, NonlinearModel):
        return _nonlinear(model)
    if isinstance(model, ConvertedModel):
        return _converted(model)
    if isinstance(model, VaryingModel):
        return _varying(model)
    assert isinstance(model, LinearModel), model.kind
    return [_linear(model), _initial(model.initial)]


def _converted(model: ConvertedModel) -> list[Lines]:
    measured = replace(
        model.positions,
        R=np.diag(model.variances),
        measurement_names=model.measurement_names,
        measurement_range=model.measurement_range,
    )
    coordinates = f"coordinates = {_text(model.coordinates)}"
    return [[*_linear(measured), coordinates], _initial(model.initial)]


def _varying(model: VaryingModel) -> list[Lines]:
    """Formulas as they were given."""
    n, m, controls = model.n, model.m, model.p - len(model.inputs)
    lines = ["[model]", 'kind = "linear"', f"state = {_texts(model.state_names)}"]
    lines += [f"unit = {_texts(model.state_units)}"] if any(model.state_units) else []
    lines.append(f"measurement = {_texts(model.measurement_names)}")
    lines += [f"control = {_texts(model.control_names[:controls])}"] if controls else []
    lines.append(f"H = {_matrix(model.fixed.H)}")
    lines += [f"{key} = {_rows(model.texts[key], size)}" for key, size in (("F", n), ("Q", n), ("R", m))]
    if controls:
        wide = model.texts["B"]
        flat = [wide[place] for place in range(len(wide)) if place % model.p < controls]
        lines.append(f"B = {_rows(flat, controls)}")
    lines.append(f"offset = {_texts(model.texts['offset'])}")
    lines.append(f"measurement_offset = {_vector(model.fixed.measurement_offset)}")
    limits = model.measurement_range
    lines += [f"measurement_range = {_matrix(limits)}"] if limits is not None else []
    return [lines, *_constants(model.constants), _inputs(model.inputs), _initial(model.initial)]


def _rows(entries: Sequence[str], size: int) -> str:
    return f"[{', '.join(_texts(entries[k : k + size]) for k in range(0, len(entries), size))}]"


def _constants(constants: Mapping[str, float]) -> list[Lines]:
    lines = [f"{name} = {_number(value)}" for name, value in constants.items()]
    return [["[model.constants]", *lines]] if lines else []


def _inputs(inputs: Sequence[RunTimeInput]) -> Lines:
    lines = []
    for each in inputs:
        origin = ', from = "time"' if each.from_time else ""
        lines.append(f"{each.name} = {{ range = {_vector([each.low, each.high])}{origin} }}")
    return ["[model.inputs]", *lines] if lines else []


def _nonlinear(model: NonlinearModel) -> list[Lines]:
    """Formulas as they were given; those of Python functions as what they compute."""
    names = {"x": model.state_names, "u": model.control_names, "z": model.measurement_names}
    angles = [model.measurement_names[j] for j in sorted(model.angles)]
    angles += [model.state_names[i] for i in sorted(model.state_angles)]
    gain = None
    if model.G is not None:
        flat, q = _formulas(model, "G", model.G, names), len(model.Q)
        gain = [flat[row : row + q] for row in range(0, len(flat), q)]
    lines = ["[model]", f"kind = {_text(model.kind)}", f"state = {_texts(model.state_names)}"]
    lines += [f"unit = {_texts(model.state_units)}"] if any(model.state_units) else []
    lines.append(f"measurement = {_texts(model.measurement_names)}")
    controls = model.control_names[: model.p - len(model.inputs)]
    lines += [f"control = {_texts(controls)}"] if controls else []
    lines += [f"angles = {_texts(angles)}"] if angles else []
    lines.append(f"f = {_texts(_formulas(model, 'f', model.f, names))}")
    lines.append(f"h = {_texts(_formulas(model, 'h', model.h, names))}")
    lines += [f"G = [{', '.join(map(_texts, gain))}]"] if gain else []
    for key, found, fixed in (("Q", model.Q_formulas, model.Q), ("R", model.R_formulas, model.R)):
        text = None if found is None else _rows(_formulas(model, key, found, names), len(fixed))
        lines.append(f"{key} = {_matrix(fixed) if text is None else text}")
    limits = model.measurement_range
    lines += [f"measurement_range = {_matrix(limits)}"] if limits is not None else []
    blocks = [lines, *_constants(model.constants), _inputs(model.inputs)]
    initial = model.initial
    if isinstance(initial, Initial):
        return [*blocks, _initial(initial)]
    start = f"x = {_texts(_formulas(model, 'x', initial.mean, names))}"
    return [*blocks, ["[model.initial]", 'kind = "measured"', start, f"P = {_matrix(initial.P)}"]]


def _formulas(
    model: NonlinearModel, key: str, found: Formulas, names: Mapping[str, tuple[str, ...]]
) -> tuple[str, ...]:
    text = model.texts.get(key) or written(found, names)
    if text is None:
        problem = "this Python function is too long as formulas: give it as strings, with shorter parts"
        raise OutputError(f"model.{key}: {problem}")
    return text


def _multiple(model: MultipleModel) -> list[Lines]:
    head = ["[model]", f"kind = {_text(model.kind)}"]
    head.append(f"transition = {_matrix(model.transition_probabilities)}")
    head.append(f"probabilities = {_vector(model.probabilities)}")
    blocks = [head]
    for mode in model.modes:
        _, *lines = _linear(mode)
        _, *start = _initial(mode.initial)
        blocks += [["[[model.modes]]", *lines], ["[model.modes.initial]", *start]]
    return blocks


def _linear(model: LinearModel) -> Lines:
    lines = ["[model]", 'kind = "linear"', f"state = {_texts(model.state_names)}"]
    if any(model.state_units):
        lines.append(f"unit = {_texts(model.state_units)}")
    lines.append(f"measurement = {_texts(model.measurement_names)}")
    if model.p:
        lines.append(f"control = {_texts(model.control_names)}")
    for key in ("F", "H", "Q", "R", "B", "measurement_range"):
        matrix = getattr(model, key)
        if matrix is not None and matrix.size:
            lines.append(f"{key} = {_matrix(matrix)}")
    for key in ("offset", "measurement_offset"):
        vector = getattr(model, key)
        if vector.any():
            lines.append(f"{key} = {_vector(vector)}")
    return lines


def _initial(initial: Initial) -> Lines:
    is_given = initial.points == 1 and initial.before_update
    is_given = is_given and not initial.from_measurement.any() and not initial.from_state.any()
    is_given = is_given and initial.from_control is None
    lines = ["[model.initial]", f'kind = "{"given" if is_given else "affine"}"', f"x = {_vector(initial.x)}"]
    if not is_given:
        lines.append(f"from_measurement = {_matrix(initial.from_measurement)}")
        lines.append(f"from_state = {_matrix(initial.from_state)}")
        if initial.from_control is not None:
            lines.append(f"from_control = {_matrix(initial.from_control)}")
        if initial.from_noise is not None:
            lines.append(f"from_noise = {_matrix(initial.from_noise)}")
        lines.append(f"points = {initial.points}")
        lines.append(f"before_update = {str(initial.before_update).lower()}")
    return [*lines, f"P = {_matrix(initial.P)}"]


def _algorithm(algorithm: Algorithm) -> Lines:
    # Every word, number and flag of JSON is one of TOML.
    options = [f"{key.name} = {json.dumps(getattr(algorithm, key.name))}" for key in fields(algorithm)]
    return ["[algorithm]", f"kind = {_text(algorithm.kind)}", *options]


def _numerics(numerics: FixedSpecification | FloatSpecification) -> Lines:
    if isinstance(numerics, FloatSpecification):
        return _float(numerics)
    lines = ["[numerics]", 'kind = "fixed"', f"width = {numerics.width}"]
    lines += [f"{name} = {_form(form)}" for name, form in numerics.classes.items()]
    lines.append(f"rounding = {_text(numerics.rounding.value)}")
    lines.append(f"overflow = {_text(numerics.overflow.value)}")
    lines.append(f"scale = {_scale(numerics.scale)}")
    lines.append(f"covariance_scale = {_scale(numerics.covariance_scale)}")
    lines += [f"division = {_division(numerics.division)}", f"functions = {_functions(numerics.functions)}"]
    return [*lines, f"coast = {numerics.coast}"]


def _float(numerics: FloatSpecification) -> Lines:
    lines = ["[numerics]", 'kind = "float"']
    lines += [f"exponent = {numerics.exponent}", f"mantissa = {numerics.mantissa}"]
    lines.append(f"rounding = {_text(numerics.rounding.value)}")
    flags = (("subnormals", numerics.subnormals), ("fused", numerics.fused))
    return [*lines, *(f"{key} = {str(value).lower()}" for key, value in flags)]


def _signals(numerics: FixedSpecification | FloatSpecification) -> Lines:
    if isinstance(numerics, FloatSpecification) or not numerics.signals:
        return []
    lines = [f"{_text(name)} = {_form(form)}" for name, form in numerics.signals.items()]
    return ["[numerics.signals]", *lines]


def _headroom(numerics: FixedSpecification | FloatSpecification) -> Lines:
    if isinstance(numerics, FloatSpecification) or not numerics.headroom:
        return []
    return ["[numerics.headroom]", *(f"{_text(name)} = {bits}" for name, bits in numerics.headroom.items())]


def _hardware(design: Design) -> Lines:
    if design.processor is not None:
        return _processor(design.processor)
    return _architecture(design.architecture) if design.shape is None else _shape(design.shape)


def _architecture(architecture: Architecture) -> Lines:
    interval = '"bound"' if architecture.interval is None else str(architecture.interval)
    lines = ["[architecture]", f"interval = {interval}", f"channels = {architecture.channels}"]
    if architecture.clock_mhz is not None:
        lines.append(f"clock_mhz = {_number(architecture.clock_mhz)}")
    if architecture.multiplier_blocks is not None:
        lines.append(f"multiplier_blocks = {architecture.multiplier_blocks}")
    if architecture.multiplier is not Architecture().multiplier:
        lines.append(f"multiplier = {_text(architecture.multiplier.value)}")
    if architecture.units is not None:
        lines.append(f"units = {_counts(architecture.units)}")
    if architecture.clocks is not None:
        lines.append(f"clocks = {_counts(architecture.clocks)}")
    if architecture.latency is not None:
        lines.append(f"latency = {architecture.latency}")
    if architecture.iterative:
        lines.append(f"iterative = [{', '.join(map(_text, architecture.iterative))}]")
    if architecture.updates_per_second is not None:
        lines.append(f"updates_per_second = {_number(architecture.updates_per_second)}")
    if architecture.solver_seconds != Architecture().solver_seconds:
        lines.append(f"solver_seconds = {_number(architecture.solver_seconds)}")
    if architecture.lanes > 1:
        lines += [f"lanes = {architecture.lanes}", f"streams = {_text(architecture.streams)}"]
    if architecture.coefficients != Architecture().coefficients:
        lines.append(f"coefficients = {_text(architecture.coefficients)}")
    return lines


def _counts(counts: Mapping[str, int]) -> str:
    listed = ", ".join(f"{kind} = {count}" for kind, count in counts.items())
    return f"{{ {listed} }}" if listed else "{}"


def _processor(processor: Processor) -> Lines:
    given = {key.name: getattr(processor, key.name) for key in fields(processor)}
    lines = [f"{name} = {value}" for name, value in given.items() if value is not None]
    return ["[architecture]", 'kind = "processor"', *lines]


def _shape(shape: Shape) -> Lines:
    given = {key.name: getattr(shape, key.name) for key in fields(shape) if key.name != "units"}
    lines = [f"{key} = {value}" for key, value in given.items() if value is not None]
    return ["[architecture]", 'control = "writable"', f"units = {_counts(shape.units)}", *lines]


def _target(target: Target) -> Lines:
    lines = [
        "[target]",
        f"device = {_text(target.device)}",
        f"grade = {target.grade}",
        f"seeds = {target.seeds}",
    ]
    if target.rounds:
        lines.append(f"rounds = {target.rounds}")
    if target.derate:
        factors = ", ".join(f"{kind} = {_number(factor)}" for kind, factor in target.derate.items())
        lines.append(f"derate = {{ {factors} }}")
    return lines


def _form(form: Form) -> str:
    if isinstance(form, Fixed):
        signed = str(form.signed).lower()
        return f"{{ width = {form.width}, fraction = {form.fraction}, signed = {signed} }}"
    return str(form)


def _functions(functions: FunctionMethod | None) -> str:
    if isinstance(functions, Interpolation):
        return f"{{ table = {functions.index_bits} }}"
    return '"auto"' if functions is None else '"cordic"'


def _division(division: DivisionMethod) -> str:
    if isinstance(division, LongDivision):
        return f'"radix{division.radix}"'
    return f"{{ table = {division.index_bits}, newton = {division.iterations} }}"


def _scale(scale: str | float | tuple[float, ...]) -> str:
    if isinstance(scale, str):
        return _text(scale)
    return _vector(scale) if isinstance(scale, tuple) else _number(scale)


def _matrix(matrix: Array) -> str:
    if matrix.shape[0] == matrix.shape[1] and not (matrix - np.diag(np.diag(matrix))).any():
        return f"{{ diagonal = {_vector(np.diag(matrix))} }}"
    rows = ",\n    ".join(_vector(row) for row in matrix)
    return f"[\n    {rows},\n]" if len(matrix) > 1 else f"[{rows}]"


def _vector(numbers: Iterable[float]) -> str:
    return f"[{', '.join(_number(value) for value in numbers)}]"


def _number(value: float) -> str:
    return repr(float(value))


def _texts(texts: Iterable[str]) -> str:
    return f"[{', '.join(map(_text, texts))}]"


def _text(text: str) -> str:
    # Every JSON string is a basic string of TOML.
    return json.dumps(text)
