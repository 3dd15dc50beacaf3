"""Sampled blocks: a diagram refuses what cannot be wired and computes what can."""

from __future__ import annotations

import numpy as np
import pytest

from firmware_sim.studies.blocks import Diagram, DiagramError, Port, SampledBlock


class Integrator(SampledBlock):
    """x <- x + h k u."""

    states = 2
    inputs = (Port("u", 2),)
    outputs = (Port("x", 2),)
    parameters = ("gain",)

    def output(self, state, signals):
        return {"x": state}

    def update(self, state, signals):
        return state + self.sample_time_s * self.values[0] * signals["u"]


class Sum(SampledBlock):
    """a + b at once."""

    inputs = (Port("a", 2, True), Port("b", 2, True))
    outputs = (Port("sum", 2),)

    def output(self, state, signals):
        return {"sum": signals["a"] + signals["b"]}


def diagram(*blocks):
    made = Diagram(0.1, [Port("one", 2), Port("three", 3)])
    for block in blocks:
        made.add(block)
    return made


def constant(_step):
    return {"one": np.array([1.0, -2.0]), "three": np.zeros(3)}


def test_feedback_through_a_state():
    # x' = 1 - x in steps of 0.1: x = 1 - 0.9^k.
    made = diagram(Sum("sum", 0.1), Integrator("x", 0.1, [1.0]), Integrator("minus", 0.1, [-1.0]))
    made.wire("one", "sum.a")
    made.wire("minus.x", "sum.b")
    made.wire("sum.sum", "x.u")
    made.wire("sum.sum", "minus.u")
    found = made.run(20, constant, ["x.x"])["x.x"]
    assert found[:, 0] == pytest.approx(1.0 - 0.9 ** np.arange(1, 21))
    assert made.run(20, constant, ["x.x"], stride=5)["x.x"] == pytest.approx(found[4::5])


def test_description():
    assert Integrator("x", 0.1, [1.0]).describe() == (
        "x: 2 discrete states, inputs of 2 (u), outputs of 2 (x), 1 tunable parameters (gain), sample time 0.1 s"
    )


@pytest.mark.parametrize(
    ("start", "end", "expected"),
    [
        ("three", "x.u", "three -> x.u: expected 2 numbers, found 3"),
        ("two", "x.u", "two: expected a source of one, three, found 'two'"),
        ("y.x", "x.u", "y.x: expected a block of x, found 'y'"),
        ("x.y", "x.u", "x: expected an output of x, found 'y'"),
        ("one", "x.v", "x: expected an input of u, found 'v'"),
    ],
)
def test_wires_that_cannot_be(start, end, expected):
    with pytest.raises(DiagramError, match=expected):
        diagram(Integrator("x", 0.1, [1.0])).wire(start, end)


def test_other_mistakes():
    made = diagram(Integrator("x", 0.1, [1.0]))
    with pytest.raises(DiagramError, match=r"x.u: expected a wire, found none"):
        made.run(1, constant, [])
    made.wire("one", "x.u")
    with pytest.raises(DiagramError, match="expected a free input, found one that is wired"):
        made.wire("one", "x.u")
    with pytest.raises(DiagramError, match="x: expected a name of its own"):
        made.add(Integrator("x", 0.1, [1.0]))
    with pytest.raises(DiagramError, match=r"sample time of 0.1 s, found 0.2 s"):
        made.add(Integrator("y", 0.2, [1.0]))
    with pytest.raises(DiagramError, match=r"expected 1 parameters \(gain\), found 2"):
        Integrator("y", 0.1, [1.0, 2.0])


def test_an_algebraic_loop_is_refused():
    made = diagram(Sum("a", 0.1), Sum("b", 0.1))
    for start, end in (("one", "a.a"), ("b.sum", "a.b"), ("one", "b.a"), ("a.sum", "b.b")):
        made.wire(start, end)
    with pytest.raises(DiagramError, match="a, b: expected a state somewhere between them, found an algebraic loop"):
        made.run(1, constant, [])
