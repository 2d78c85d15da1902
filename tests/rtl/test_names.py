"""Names in the Verilog come from the equations."""

from kalmanhdl.graph.operations import Add, Graph, Input
from kalmanhdl.rtl.names import identifier, operation_names


def test_an_equation_reads_on_in_its_signal():
    assert identifier("predict: P[0,1]") == "predict_P_0_1"
    assert identifier("z[0]") == "z_0"
    assert identifier("2x") == "n_2x"


def test_the_last_operation_of_an_equation_has_its_name_and_the_others_their_index():
    operations = (Input("z[0]"), Add(0, 0), Add(1, 0), Add(2, 0))
    graph = Graph(operations, ("z[0]", "update: x[0]", "update: x[0]", "update: x[0]"), (), ())
    assert operation_names(graph) == ("z_0", "update_x_0_n1", "update_x_0_n2", "update_x_0")


def test_names_are_unique_even_where_origins_imitate_them():
    operations = (Input("a"), Input("b"), Add(0, 1))
    names = operation_names(Graph(operations, ("a_n1", "a", "a"), (), ()))
    assert len(set(names)) == 3
