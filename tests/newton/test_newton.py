# SPDX-License-Identifier: MIT
"""Newton on small equations without contact: order, tests of convergence, record."""

from dataclasses import replace

import numpy as np
import pytest

import fenics_mortar as fm
from fenics_mortar.newton.loop import (
    LOOSE_FORCING,
    MAX_FORCING,
    Iteration,
    NewtonReport,
    Status,
    Step,
    forcing,
    merge_repeated,
    period_of,
    solve,
)
from fenics_mortar.rigid import proximal


class Root:
    """x^2 = 2 by Newton's method, or by a method with a wrong derivative."""

    def __init__(self, x=1.0, factor=1.0, changes=()):
        self.x, self.factor, self.changes = x, factor, list(changes)
        self.remedies = self

    def evaluate(self, *, start):
        changed = self.changes.pop(0) if self.changes else 0
        return Status(abs(self.x**2 - 2), 2.0, 0.0, 1, changed, 1e-15)

    def advance(self):
        dx = -(self.x**2 - 2) / (2 * self.x * self.factor)
        self.x += dx
        return Step(abs(dx / self.x), 1.0)

    def merge_sets(self, period):
        self.merged = period
        return f"a cycle of {period}"

    def seconds(self):
        return {"solve": 1.0}

    def diagnose(self):
        return "x is not finite"

    def drifts(self):
        return ""


def test_newton_converges_quadratically():
    report = solve(Root(), fm.NewtonOptions())
    r = np.array(report.residuals)
    assert report.converged and report.num_iterations <= 6
    assert (r[1:4] <= r[:3] ** 2).all()


def test_newton_continues_while_sets_change():
    report = solve(Root(changes=[0] * 7 + [1]), fm.NewtonOptions())
    assert report.num_iterations == 5
    report = solve(Root(changes=[0, 1, 1, 1, 1, 1, 1, 1]), fm.NewtonOptions())
    assert report.num_iterations == 8


@pytest.mark.parametrize(
    "sets, period",
    [
        ("", 0),
        ("ABC", 0),
        ("ABA", 0),  # a set may occur again
        ("ABAB", 2),
        ("XABAB", 2),
        ("ABCABC", 3),
        ("AAAA", 0),  # unchanged sets are not a cycle
        ("ABABAAAA", 0),
    ],
)
def test_cycle_of_sets_is_detected_after_two_periods(sets, period):
    assert period_of([letter.encode() for letter in sets]) == period


def test_cycle_is_left_and_recorded():
    class Chattering(Root):
        """Sets that alternate until they are merged."""

        merged = 0
        count = 0

        def evaluate(self, *, start):
            self.count += 1
            sets = b"C" if self.merged else (b"A", b"B")[self.count % 2]
            status = super().evaluate(start=start)
            return replace(status, sets=sets, num_changed=0 if self.merged else 1)

    equations = Chattering()
    report = solve(equations, fm.NewtonOptions())
    assert equations.merged == 2
    assert report.converged and report.notes == ["iteration 3: a cycle of 2"]
    assert "a cycle of 2" in report.table()


@pytest.mark.parametrize("factor, merged", [(2.0, False), (100.0, True)])
def test_sets_that_change_for_long_are_merged_unless_the_residual_falls(factor, merged):
    """The error is halved, or decreases by 1 %, in each of the 16 iterations with changes."""
    equations = Root(factor=factor, changes=[1] * 16)
    with pytest.raises(fm.NotConvergedError) as failure:
        solve(equations, fm.NewtonOptions(max_iterations=16))
    assert any("a cycle of 12" in note for note in failure.value.report.notes) == merged


@pytest.mark.parametrize("factor", [2.0, 4.0])
def test_tentative_solve_ends_after_a_bad_first_iteration(factor):
    """For x^2 - 2 at 3 the residual ratio is 0.44 with half the step and 0.1 with a full one."""
    assert solve(Root(x=3.0), fm.NewtonOptions(max_remaining=0.4)).converged
    with pytest.raises(fm.NotConvergedError, match="hardly reduced the residual") as failure:
        solve(Root(x=3.0, factor=factor), fm.NewtonOptions(max_remaining=0.4))
    assert failure.value.report.num_iterations == 1


def test_failure_contains_the_record_and_the_failed_tests():
    with pytest.raises(fm.NotConvergedError, match="residual .* .allowed") as failure:
        solve(Root(factor=3.0), fm.NewtonOptions(max_iterations=4))
    assert len(failure.value.report.iterations) == 5
    assert not failure.value.report.converged


def test_state_that_is_not_finite_is_diagnosed():
    with pytest.raises(fm.NotConvergedError, match="iteration 0: .* x is not finite"):
        solve(Root(x=np.nan), fm.NewtonOptions())


def test_error_in_a_step_contains_the_record():
    class Broken(Root):
        def advance(self):
            raise fm.MortarError("singular")

    with pytest.raises(fm.NotConvergedError, match="iteration 1: singular") as failure:
        solve(Broken(), fm.NewtonOptions())
    assert len(failure.value.report.iterations) == 1


def test_shortened_step_is_not_convergence():
    class Short(Root):
        def advance(self):
            return Step(super().advance().increment, 0.5)

    with pytest.raises(fm.NotConvergedError, match="last step shortened to the fraction 5.0e-01"):
        solve(Short(), fm.NewtonOptions(max_iterations=8))


def test_table_is_markdown_with_a_row_per_iteration():
    report = solve(Root(), fm.NewtonOptions())
    lines = str(report).splitlines()
    assert lines[0].count("|") == lines[2].count("|") == 7
    assert sum(line.startswith("|") for line in lines) == 2 + len(report.iterations)
    assert "converged in" in lines[-1]
    assert report.total_seconds() == {"solve": float(len(report.iterations))}


@pytest.mark.serial
@pytest.mark.parametrize("residuals", [[0.0], [0.0, 0.0], [1e-3, 0.0], [0.0, 1e-3], [1.0, 1e-3]])
@pytest.mark.parametrize("goal", [0.0, 1e-12])
def test_forcing_term_is_valid_for_all_residuals(residuals, goal):
    """Without loads all residuals are zero; contact may begin between two iterations."""
    assert 0.0 < forcing(residuals, goal) <= MAX_FORCING
    assert 0.0 < forcing(residuals, goal, force=2.0) <= LOOSE_FORCING


@pytest.mark.serial
def test_linear_residual_is_small_beside_the_reference_force():
    """A prescribed motion dominates the first residual: a fraction of it exceeds all forces."""
    first = forcing([1e6], 1e-10, force=1.0)
    assert first == MAX_FORCING
    further = forcing([1e6, 100.0, 50.0], 1e-10, force=1.0)
    assert 50.0 * further == pytest.approx(LOOSE_FORCING)
    assert forcing([1e6, 1.0, 0.5], 1e-10, force=1.0) == LOOSE_FORCING
    assert forcing([1e6, 1.0, 0.5], 1e-10) == MAX_FORCING
    assert forcing([1e6, 1.0, 0.5], 1e-10, force=1.0, sets_change=False) == MAX_FORCING


@pytest.mark.serial
def test_linear_residual_may_be_a_hundredth_of_the_tolerance():
    """With factors of an earlier iteration (no reference force) it remains relative."""
    residuals, goal = [1e-2, 1e-4, 1e-8], 1e-10
    assert 1e-8 * forcing(residuals, goal, force=1.0, sets_change=False) == pytest.approx(1e-12)
    assert forcing(residuals, goal) == MAX_FORCING


class Springs:
    """Equations whose springs have no effect."""

    def __init__(self):
        self.springs = self

    def state(self):
        return None

    def restore(self, state):
        pass

    def anchor(self, elongation, share):
        pass

    def remove_springs(self):
        pass

    def max_motion(self):
        return 0.0

    def tipping(self):
        return ""

    def remaining(self):
        return proximal.Remaining(0.0, 0.0, "")


def test_record_of_a_failed_solve_with_springs_has_all_iterations(monkeypatch):
    """The solve converges with springs, fails without them, and with five others again."""
    iteration = Iteration(1.0, 0.0, 0.0, 1.0, 0, 0, {})
    outcomes = iter([(5, True), (30, False), *5 * [(7, False)]])

    def solve(equations, options):
        count, converged = next(outcomes)
        report = NewtonReport([iteration] * (1 + count))
        if converged:
            return report
        raise fm.NotConvergedError("", report)

    monkeypatch.setattr(proximal, "solve", solve)
    first = fm.NotConvergedError("", NewtonReport([iteration] * 31))
    with pytest.raises(fm.NotConvergedError) as error:
        proximal.solve_with_springs(Springs(), fm.NewtonOptions(), first)
    assert error.value.report.num_iterations == 30 + 5 + 30 + 5 * 7


@pytest.mark.serial
def test_repeated_notes_are_merged():
    notes = ["iteration 1: a spring", "other", "iteration 3: a spring", "iteration 1: a spring"]
    expected = ["iteration 1: a spring (3 times)", "other"]
    assert merge_repeated(notes) == expected
    assert (
        merge_repeated([*expected, "iteration 7: a spring"])[0] == "iteration 1: a spring (4 times)"
    )
    one, two = (NewtonReport(notes=some) for some in (notes[:2], notes[2:]))
    assert one.followed_by(two).notes == expected


def record():
    """A damped solve: three iterations, a note."""
    rows = [(3.0, 1.0, 0), (0.2, 0.5, 2), (4e-11, 1.0, 0)]
    seconds = {"solve": 0.25, "other": 0.5}
    its = [Iteration(r, 0.1, 0.3, step, 7, changed, seconds) for r, step, changed in rows]
    report = NewtonReport(its, ["iteration 1: a spring"], force=2.0, allowed=4e-10, converged=True)
    return replace(report, reason="converged in 2 iterations", solver="direct")


@pytest.mark.serial
def test_table_is_short_and_gives_residuals_relative_to_the_force():
    head, line, *rows = str(record()).splitlines()
    assert head == "| it | residual / force | gap | step | active | changed | seconds |"
    assert line == "|" + "---:|" * 7
    assert rows[1] == "| 1 | 1.0e-01 | 1.0e-01 | 0.5 | 7 | 2 | 0.750 |"
    assert rows[3:5] == ["", "- iteration 1: a spring"]
    end = (
        "converged in 2 iterations; reference force 2.000e+00 (norm of the nodal forces), "
        "allowed residual / force 2.0e-10"
    )
    assert rows[-1] == end
    plain = replace(record(), iterations=record().iterations[::2], notes=[])
    assert str(plain).startswith("| it | residual / force | gap | active | changed | seconds |")


@pytest.mark.serial
def test_table_shows_phases_on_request():
    head, *rows = record().table(phases=True).splitlines()
    assert head.endswith("| changed | seconds | solve [s] | other [s] |")
    assert rows[4] == "| sum |  |  |  |  |  |  | 2.250 | 0.7500 | 1.5000 |"
    assert "linear solver: direct" in rows
    assert len({line.count("|") for line in (head, *rows[:5])}) == 1


@pytest.mark.serial
def test_record_of_nothing_prints():
    assert "not started" in str(NewtonReport())
    assert "not started" in NewtonReport().table(phases=True)


@pytest.mark.serial
def test_notebooks_render_reports_as_markdown():
    assert record()._repr_markdown_() == str(record())
    for kind in (fm.NewtonReport, fm.PathReport, fm.DynamicsReport, fm.Certificate):
        assert hasattr(kind, "_repr_markdown_")
    for kind in (fm.ModelReport, fm.ErrorEstimate, fm.TangentCheck):
        assert hasattr(kind, "_repr_markdown_")


def test_report_contains_the_allowed_residual():
    report = solve(Root(), fm.NewtonOptions(residual_tolerance=1e-3))
    assert report.allowed == 1e-3 * 2.0 + 1e-15
    assert report.residuals[-1] <= report.allowed
