"""Sources become words: appendix B word for word, and one message for every wrong source."""

import random
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kalmanhdl.arithmetic.fixed import Fixed
from kalmanhdl.errors import KalmanhdlError, ProgramError
from kalmanhdl.processor.assembler import assemble
from kalmanhdl.processor.core import PAPER_CORE, Core, checked
from kalmanhdl.processor.disassembler import disassemble
from kalmanhdl.processor.instructions import FUNCTIONS, PAPER, Opcode, build, decode, encode
from kalmanhdl.processor.program import image, listing, read_image

HERE = Path(__file__).parent
# The source and the machine code that stand side by side in appendix B of bhatia2012; the three dots that
# elide lines of the source elide them in the machine code as well.
SOURCE = (HERE / "appendix_b.asm").read_text()
MACHINE_CODE = tuple(int(word, 16) for word in (HERE / "appendix_b.hex").read_text().split())


def test_appendix_b_word_for_word():
    program = assemble(SOURCE, PAPER_CORE)
    assert len(program.words) == 135
    assert program.words == MACHINE_CODE
    assert program.labels == {"B000": 0, "L1": 90}
    assert program.matrices["D16"] == program.matrices["H14"] == 0x10


def test_the_codes_are_the_papers():
    codes = {operation.opcode.name: operation.opcode.value for operation in PAPER}
    assert codes == {
        "NOP": 0x00,
        "ADD_33": 0x08,
        "MULT_31": 0x09,
        "MULT_33": 0x0A,
        "DET_33": 0x0B,
        "MULT_3S": 0x0C,
        "READ": 0x10,
        "WRITE": 0x11,
        "JUMP_U": 0x14,
        "JUMP_DRDY": 0x15,
        "JUMP_ACK": 0x16,
    }


def test_a_function_is_a_word_or_its_number():
    core = Core(form=Fixed(width=16, fraction=8), extended=True, functions=FUNCTIONS)
    program = assemble("FUNC X sine Y\nFUNC X 5 Y\nHALT\n.data\nX:\nY:", core)
    assert [word >> 27 for word in program.words[:2]] == [0x1E, 0x1E]
    text = disassemble(program.words, core)
    assert [line.split() for line in text.splitlines()[1:3]] == [
        ["FUNC", "0", "sine", "1"],
        ["FUNC", "0", "arctangent", "1"],
    ]
    assert assemble(text, core).words == program.words


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("FUNC 0 cosine 1", r"column 8: the core has no function 'cosine': .*sine"),
        ("FUNC 0 1 1", r"column 8: the core has no function 1: it has sine \(0\)"),
    ],
)
def test_a_function_that_the_core_has_not_is_refused(source, message):
    core = Core(form=Fixed(width=16, fraction=8), extended=True, functions=FUNCTIONS[:1])
    with pytest.raises(ProgramError, match=message):
        assemble(source, core)
    with pytest.raises(ProgramError, match="FUNC: the core is built without functions"):
        assemble(source, replace(core, functions=()))
    words = (encode(build(Opcode.FUNC, 0, 1, 1)),)
    with pytest.raises(ProgramError, match=r"address 0: FUNC: function is 1: the core has sine \(0\)"):
        checked(words, core)


def test_tables_3_to_6_of_the_paper():
    source = """
        READ 2 L5
        WRITE L5 1
        DET_33 L4 L5
    L1: JUMP_U L2
        MULT_33 L3 L3 L4
    L2: MULT_3S L4 L4 L3
        JUMP_DRDY_I L1
        NOP
    .data
    L3:
    L4:
    L5: five
    """
    words = assemble(source, PAPER_CORE).words
    texts = [f"{decode(word).opcode.name} {decode(word).arguments}" for word in words]
    assert texts == [
        *("READ (0, 2, 2)", "WRITE (2, 1, 0)", "DET_33 (1, 0, 2)", "JUMP_U (5, 0, 0)"),
        *("MULT_33 (0, 0, 1)", "MULT_3S (1, 1, 0)", "JUMP_DRDY (3, 0, 0)", "NOP (0, 0, 0)"),
    ]


@given(st.lists(st.integers(0, 2**32 - 1), min_size=1, max_size=64))
def test_any_words_disassemble_to_a_source_of_the_same_words(words):
    words = [*words, *(encode(decode(word)) for word in MACHINE_CODE[:4])]
    source = disassemble(tuple(words), PAPER_CORE)
    assert assemble(source, PAPER_CORE).words == tuple(words)


def test_an_image_reads_back():
    program = assemble(SOURCE, PAPER_CORE)
    assert read_image(image(program), "image").words == program.words
    assert checked(program.words, PAPER_CORE)[1].opcode is Opcode.READ


def test_a_listing_has_addresses_words_and_source_side_by_side():
    lines = listing(assemble(SOURCE, PAPER_CORE)).splitlines()
    assert lines[1] == "000  00000000      2  B000: NOP"
    assert (
        "05B  50001007     93        MULT_33      D1      D9      D8      -- KF Implementation Code" in lines
    )
    assert lines[-1].split() == ["163", "Di:", "H23"]


WRONG = {
    "READD 0 D1": "p, line 1, column 1: unknown instruction 'READD': did you mean 'READ'?",
    "NOP\n  ADD_33 1 2": "p, line 2, column 3: ADD_33 has 3 operands (first source, second source, "
    "destination), and 2 stand here",
    "NOP 4": "p, line 1, column 5: NOP has 0 operands (none), and 1 stand here",
    "JUMP_U L9": "p, line 1, column 8: undefined program address 'L9': define it in .text; "
    "none is valid here",
    "L1: JUMP_U D1\n.data\nD1:": "p, line 1, column 12: D1 is no program address: "
    "what is one is defined in .text",
    "READ 9 0": "p, line 1, column 6: element 9 is outside 0 to 8",
    "READ A 0": "p, line 1, column 6: 'A' is no element: write 0 to 8",
    "ADD_33 1 2 512": "p, line 1, column 12: matrix 512 is outside 0 to 511",
    "ADD_33 1 2 x\n.data\ny:": "p, line 1, column 12: undefined matrix 'x': define it in .data; "
    "only 'y' is valid",
    "L: NOP\nL: NOP": "p, line 2, column 1: L is defined already: give every place its own name",
    "1: NOP": "p, line 1, column 1: '1' is no name: use letters, digits and _, and begin with no digit",
    "READ: NOP": "p, line 1, column 1: READ is an instruction: call it something else",
    "NOP\n.data\nx": "p, line 3, column 1: 'x': a line of .data begins with a name and a colon, NAME:",
    "NOP\n.data\nx: a b": "p, line 3, column 6: 'b': a matrix has one name and at most one more",
    ".text 0": "p, line 1, column 7: '0': nothing stands behind .text",
    ".word 0x100000000": "p, line 1, column 7: '0x100000000' is no word: write a number of 32 bits",
    ".word": "p, line 1, column 1: .word has one operand, a word such as 0x80000000",
    "-- nothing": "p: there is no instruction: write at least one below .text",
}


@pytest.mark.parametrize("source", WRONG)
def test_a_wrong_source_has_one_message_with_its_place(source):
    with pytest.raises(ProgramError) as caught:
        assemble(source, PAPER_CORE, "p")
    assert str(caught.value) == WRONG[source]


def test_what_does_not_fit_the_stores_is_refused():
    small = Core(form=Fixed(width=8, fraction=0), matrices=2, program_words=4)
    with pytest.raises(ProgramError, match="line 5, column 1: the control store has 4 words"):
        assemble("NOP\n" * 5, small)
    with pytest.raises(ProgramError, match="line 5, column 1: the data store has 2 matrices"):
        assemble("NOP\n.data\na:\nb:\nc:", small)
    with pytest.raises(ProgramError, match="line 5, column 8: end stands behind the last word"):
        assemble("NOP\nNOP\nNOP\n\nJUMP_U end\nend:", small)
    with pytest.raises(ProgramError, match="5 words and the control store 4"):
        checked((0,) * 5, small)
    with pytest.raises(ProgramError, match="address 1: JUMP_U: target is 4: the control store has"):
        checked((0, encode(decode(0xA0100000))), small)


EXTENDED = Core(form=Fixed(width=16, fraction=9), extended=True)
WRONG_LOOPS = {
    "NOP\nL: NEXT L": "p, line 2, column 4: NEXT: there is no LOOP that it could end",
    "LOOP 2\nNOP": "p, line 1, column 1: LOOP: no NEXT ends it",
    "LOOP 2\nNOP\nL: NEXT L": "p, line 3, column 4: NEXT: goes to 2, and its loop begins at 1",
    "LOOP 2\nL: NOP\nJUMP_U E\nNEXT L\nE: NOP": "p, line 3, column 1: JUMP_U: 4 lies across a loop's border",
    "LOOP 0": "p, line 1, column 6: count 0 is outside 1 to 511",
    "SCALE 0 6 0": "p, line 1, column 9: exponent 6 is outside -9 to 5",
    "LOOP 2\nA: LOOP 2\nB: LOOP 2\nC: LOOP 2\nD: LOOP 2\nE: NEXT E": "p, line 5, column 4: "
    "LOOP: the stack of loops holds 4: put fewer into each other",
}


@pytest.mark.parametrize("source", WRONG_LOOPS)
def test_a_wrong_loop_is_refused_before_it_runs(source):
    with pytest.raises(ProgramError) as caught:
        assemble(source, EXTENDED, "p")
    assert str(caught.value) == WRONG_LOOPS[source]


def test_a_core_says_which_instructions_it_lacks():
    with pytest.raises(ProgramError, match="line 1, column 1: SUB_33: the core has the paper's instructions"):
        assemble("SUB_33 0 0 0", PAPER_CORE)
    with pytest.raises(ProgramError, match="DET_33: it is for matrices of 3 by 3, and the core's are 2 by 2"):
        assemble("DET_33 0 0", Core(form=Fixed(width=8, fraction=0), size=2, extended=True))


WRONG_WORDS = {
    0xF8000000: "address 0: word 0xF8000000: there is no instruction with the opcode 0x1F",
    0x08000000: "address 0: HALT: the core has the paper's instructions alone: take an extended one",
    0x00000001: "address 0: word 0x00000001: NOP has no argument 3, yet it is 1: it must be zero",
    0x80001201: "address 0: READ: element is 9: a matrix has the elements 0 to 8",
}


@pytest.mark.parametrize("word", WRONG_WORDS)
def test_a_wrong_word_is_refused_before_it_runs(word):
    with pytest.raises(ProgramError) as caught:
        checked((word,), PAPER_CORE)
    assert str(caught.value) == WRONG_WORDS[word]


def test_a_thousand_malformed_sources_and_images_end_in_one_message_each():
    rng, messages = random.Random(5), []
    texts = [SOURCE, image(assemble(SOURCE, PAPER_CORE))]
    while len(messages) < 1000:
        message = complaint(mutated(rng, texts[len(messages) % 2]), len(messages) % 2)
        if message is not None:
            messages.append(message)
    assert all(len(message.splitlines()) == 1 and len(message) < 400 for message in messages)


def complaint(text, is_image):
    """What is said of a source or an image, or None where it can be run."""
    try:
        program = read_image(text, "p") if is_image else assemble(text, PAPER_CORE, "p")
        checked(program.words, PAPER_CORE)
    except KalmanhdlError as error:
        return str(error)
    return None


def mutated(rng, text):
    """A text with a few of its pieces removed, doubled, exchanged or replaced by something else."""
    pieces = text.split("\n")
    for _ in range(rng.randint(1, 3)):
        at = rng.randrange(len(pieces))
        words = pieces[at].split(" ")
        word = rng.randrange(len(words))
        words[word] = rng.choice(
            ("", "512", "-1", "D1", "L1", ".data", "x:", "\x00", "NOP", "é", "9" * 30, "0x")
        )
        pieces[at] = rng.choice((" ".join(words), pieces[rng.randrange(len(pieces))], pieces[at][1:]))
    return "\n".join(pieces)
