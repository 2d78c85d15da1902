"""The Verilog text: it runs as the interpreter says in another simulator, and depends on the plan alone."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from random import Random

import pytest
from devices import PLAUSIBLE
from graphs import alpha_beta, typed_graphs
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from icarus import simulate
from steps import expected, random_steps, well_formed

from kalmanhdl.rtl.filter import Filter
from kalmanhdl.rtl.interface import interface
from kalmanhdl.rtl.verilog import header, to_rtlil
from kalmanhdl.toolchain.yosys import rtlil_to_verilog
from planning import planned

needs_icarus = pytest.mark.skipif(shutil.which("iverilog") is None, reason="no Icarus Verilog")


def runs_in_icarus(folder, plan, steps):
    text = rtlil_to_verilog(to_rtlil(Filter(plan), "tracker"), "tracker", header(plan, "tracker"))
    results, states = simulate(folder, text, "tracker", interface(plan), steps)
    wanted, written = expected(plan, steps)
    assert results == wanted
    for name, values in states.items():
        assert values == [step[name] for step in written], name


@needs_icarus
@pytest.mark.parametrize(("interval", "channels"), [(1, 1), (None, 1), (1, 16), (2, 3)])
def test_every_output_and_every_new_state_is_right_in_another_simulator(tmp_path, interval, channels):
    plan = planned(alpha_beta(), PLAUSIBLE, interval, channels)
    runs_in_icarus(tmp_path, plan, random_steps(plan, 2000, Random(7)))


@needs_icarus
@pytest.mark.slow
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    typed_graphs(),
    st.sampled_from([None, 1, 2, 3, 5]),
    st.integers(1, 5),
    st.randoms(use_true_random=False),
)
def test_any_graph_is_right_in_another_simulator(tmp_path, typed, interval, channels, random):
    assume(well_formed(typed))
    plan = planned(typed, PLAUSIBLE, interval, channels)
    runs_in_icarus(tmp_path, plan, random_steps(plan, 200, random))


_PRINT = """
import sys; sys.path[:0] = sys.argv[1:]
from graphs import alpha_beta
from devices import PLAUSIBLE
from kalmanhdl.rtl.filter import Filter
from kalmanhdl.rtl.verilog import header, to_rtlil
from planning import planned
plan = planned(alpha_beta(), PLAUSIBLE, 1, 16)
print(header(plan, "tracker") + to_rtlil(Filter(plan), "tracker"))
"""


def test_the_text_depends_neither_on_the_folder_nor_on_the_hash_seed(tmp_path):
    graphs = Path(sys.modules["graphs"].__file__).parent
    texts = {
        subprocess.run(
            [sys.executable, "-c", _PRINT, str(graphs), str(graphs.parent)],
            cwd=folder,
            env={**os.environ, "PYTHONHASHSEED": seed},
            check=True,
            capture_output=True,
        ).stdout
        for folder, seed in ((tmp_path, "1"), (Path.cwd(), "2"))
    }
    assert len(texts) == 1
    text = texts.pop().decode()
    assert str(Path.cwd()) not in text
    assert ".py" not in text


def test_the_header_names_every_port_with_its_format_and_scale():
    plan = planned(alpha_beta(), PLAUSIBLE, 1, 16)
    text = header(plan, "tracker")
    ports = interface(plan)
    assert all(port.name in text for port in (*ports.numbers, *ports.present, *ports.outputs))
    assert "in_z                     s16  z, fixed(16, fraction=8), last bit = 0.015625" in text
    assert "of two steps of one track: 11" in text
