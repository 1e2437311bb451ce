"""The grammar of `--check`: what it measures, and what it says of mistakes."""

from __future__ import annotations

import pytest

from lidarcli.errors import OptionError
from lidarcli.reports.checks import DEEPEST, columns_needed, judge, parse_check
from lidarcli.reports.columns import Run
from lidarcli.reports.summary import summarise
from tests.reports.runs import crossing, run_of, sweep, thing


@pytest.fixture(scope="module")
def run() -> Run:
    objects = [
        thing(0, 1, width=0.4, r_min=0.9),
        thing(0, 2, width=0.6, r_min=0.8, shape="round", visibility="cut"),
        thing(1, 1, width=0.7, r_min=3.0, shape="unknown", difference=-0.5, change="appeared"),
        thing(1, 2, width=4.0, set="S", shape="wall"),
    ]
    return run_of([sweep(0, 2), sweep(1, 1), sweep(2, 0)], objects)


@pytest.mark.parametrize(
    ("expression", "found"),
    [
        ("sweeps == 3", 3),
        ("objects != 4", 3),
        ("objects_per_sweep.mean between 1 and 1", 1),
        ("objects_per_sweep.max <= 2", 2),
        ("valid_share > 0.98", 0.99),
        ("rate between 9.9 and 10.1", 10),
        ("duration >= 0.2", 0.2),
        ("shape.prismatic == 1", 1),
        ("visibility.cut < 2", 1),
        ("objects where width > 0.5 and r_min < 1.0 == 1", 1),
        ("objects where width > 0.5 and range_min < 1.0 == 1", 1),
        ("objects where width > 0.5 or r_min < 1.0 == 3", 3),
        ("objects where (width > 0.5 or r_min < 1.0) and not shape == round == 2", 2),
        ("objects where shape == prismatic == 1", 1),
        ("objects where visibility != full == 1", 1),
        ("objects where shape == 'round' and visibility == \"cut\" > 0", 1),
        ("objects where width between 0.5 and 0.8 between 2 and 3", 2),
        ("objects where set == S == 1", 1),
        ("objects where width == 0.4 == 1", 1),
        ("objects where r_min >= 0.8 and r_min <= 0.9 == 2", 2),
        ("noise.max == 0.01", 0.01),
        ("objects where difference < 0 == 1", 1),
        ("objects where not difference < 0 == 0", 0),
        ("objects where difference is null == 2", 2),
        ("objects where change is not null == 1", 1),
        ("objects where change != removed == 1", 1),
        ("objects where topic == '/scan' == 3", 3),
        ("objects where topic == '/nowhere' == 0", 0),
        ("objects where vertices == 0 == 3", 3),
        ("sweeps where objects == 0 <= 1", 1),
        ("sweeps where sweep >= 1 and objects > 0 == 1", 1),
        ("width.max<1e3", 0.7),
        ("backward == -0", 0),
        ("objects where " + "(" * 50 + "width > 0.5" + ")" * 50 + " == 2", 2),
        ("objects where " + "not " * 2_000 + "width > 0.5 == 2", 2),
        ("objects where " + "not " * 2_001 + "width > 0.5 == 1", 1),
        ("objects where " + "width > 1 or " * 700 + "width > 0.5 == 2", 2),
        ("objects where " + "width > 0 and " * 700 + "width > 0.5 == 2", 2),
        ("objects where difference < 0 or difference is null == 3", 3),
        ("objects where difference < 0 and width > 0 == 1", 1),
        ("objects where not (difference < 0 and width < 0) == 3", 3),
        ("objects where not (difference < 0 or width > 0) == 0", 0),
    ],
)
def test_what_a_check_finds(run: Run, expression: str, found: float) -> None:
    verdict = judge(parse_check(expression), summarise(run).figures, run)
    assert verdict.found == pytest.approx(found)
    assert verdict.holds


@pytest.fixture(scope="module")
def tracked() -> Run:
    return run_of(**crossing())


@pytest.mark.parametrize(
    ("expression", "found"),
    [
        ("tracks == 3", 3),
        ("tracks.agents == 2", 2),
        ("agents == 21", 21),
        ("objects == 31", 31),
        ("objects where r_min > 0 == 31", 31),
        ("objects where set == O == 10", 10),
        ("sweeps where objects > 1 == 10", 10),
        ("sweeps where objects between 4 and 4 == 3", 3),
        ("sweeps where object_beams > 14 == 3", 3),
        ("agents_at_once.max <= 2", 2),
        ("agents_at_once.mean between 1.29 and 1.31", 1.3),
        ("tracks.duration.p50 > 0.6", 0.7),
        ("tracks.distance.max < 1", 0.7),
        ("tracks.sweeps.min == 5", 5),
        ("tracks.speed_max.p50 == 0.5", 0.5),
        ("tracks.shape.legged == 1", 1),
        ("tracks.end.left_view == 1", 1),
        ("tracks.end.end_of_log == 2", 2),
        ("tracks where shape == legged and distance > 0.5 == 1", 1),
        ("tracks where label == pallet and set == O >= 1", 1),
        ("tracks where end == 'left view' == 1", 1),
        ("tracks where label is null == 2", 2),
        ("tracks where last_sweep < 9 and not set == O == 1", 1),
        ("objects where set == A == 21", 21),
        ("objects where moving == 21", 21),
        ("objects where not moving == 10", 10),
        ("objects where moving == true == 21", 21),
        ("objects where moving != true and track == 1 == 10", 10),
        ("objects where moving == false == 10", 10),
        ("objects where moving is null == 0", 0),
        ("objects where vy > 0.9 == 16", 16),
        ("objects where track == 2 and shape == legged == 16", 16),
        ("objects where label == pallet == 10", 10),
        ("objects where shape == legged == 16", 16),
        ("sweeps where agents > 2 == 3", 3),
    ],
)
def test_what_a_check_finds_of_tracks(tracked: Run, expression: str, found: float) -> None:
    verdict = judge(parse_check(expression), summarise(tracked).figures, tracked)
    assert verdict.found == pytest.approx(found)
    assert verdict.holds


@pytest.mark.parametrize(
    ("expression", "needs"),
    [
        ("tracks == 5", True),
        ("agents_at_once.max <= 3", True),
        ("delta.tracks.duration.p50 > 0", True),
        ("tracks where set == A == 0", True),
        ("objects where moving == 0", True),
        ("objects where vx > 1 == 0", True),
        ("objects where track is null == 3", False),
        ("objects where set == A == 0", False),
        ("agents == 0", False),
        ("sweeps where agents > 0 == 0", False),
    ],
)
def test_which_checks_need_tracks(expression: str, needs: bool) -> None:
    assert parse_check(expression, compared=True).needs_tracks == needs


def test_tracks_that_could_not_be_read_leave_nothing_to_measure(run: Run) -> None:
    for expression in ("tracks >= 0", "tracks where sweeps > 1 == 0", "agents_at_once.max <= 3"):
        verdict = judge(parse_check(expression), summarise(run).figures, run)
        assert (verdict.holds, verdict.found) == (False, None)


@pytest.mark.parametrize(
    ("expression", "expected", "words"),
    [
        ("sweeps >= 100", ">= 100", "3"),
        ("objects_per_sweep.p95 between 5 and 6", "between 5 and 6", "1.9"),
        ("difference.mean < -1", "< -1", "-0.5"),
        ("objects where width < 0 != 0", "!= 0", "0"),
        ("agents_per_sweep.p95 > 0", "> 0", "0"),
    ],
)
def test_a_check_that_does_not_hold(run: Run, expression: str, expected: str, words: str) -> None:
    verdict = judge(parse_check(expression), summarise(run).figures, run)
    assert (verdict.holds, verdict.expected, verdict.words) == (False, expected, words)


def test_without_anything_to_measure_a_check_does_not_hold() -> None:
    empty = run_of([sweep(0)])
    verdict = judge(parse_check("width.mean < 5"), summarise(empty).figures, empty)
    assert (verdict.holds, verdict.found, verdict.words) == (False, None, "nothing to measure")


@pytest.mark.parametrize(
    ("expression", "problem"),
    [
        ("", "expected a figure such as sweeps or objects_per_sweep.mean at the end"),
        ("100 < sweeps", "expected a figure such as sweeps or objects_per_sweep.mean at '100', column 1"),
        ("sweeps", "expected a comparison (==, !=, <=, >=, <, >, between) at the end"),
        ("sweeps = 3", "cannot be read at '=', column 8"),
        ("sweeps >= many", "expected a number at 'many', column 11"),
        ("sweeps >= 3 4", "expected nothing more at '4', column 13"),
        ("sweeps >= 3.4.5", "cannot be read at '3', column 11"),
        ("sweeps between 3 or 4", "expected 'and' at 'or', column 18"),
        ("sweeps between 4 and 3", "4 is above 3: nothing is between them, at '4', column 16"),
        (
            "beams where valid > 3 == 0",
            "unknown table 'beams' before where; available: objects, sweeps, tracks, events; at 'beams', column 1",
        ),
        (
            "object where width > 3 == 0",
            "unknown table 'object' before where; did you mean objects? available: objects, sweeps, tracks, events; "
            "at 'object', column 1",
        ),
        ("objects where (width > 1 == 0", "expected ')' at '==', column 26"),
        (
            "objects where width 1 == 0",
            "expected a comparison (==, !=, <=, >=, <, >, between, is) of width at '1', column 21",
        ),
        ("objects where shape > round == 0", "expected ==, != or is (column shape holds names) at '>', column 21"),
        (
            "objects where shape == square == 0",
            "unknown shape (prismatic, round, legged, irregular, unknown, wall) at 'square', column 24",
        ),
        (
            "tracks where shape == leged == 0",
            "unknown shape (prismatic, round, legged, irregular, unknown, wall); did you mean legged? "
            "at 'leged', column 23",
        ),
        ("tracks where end == gone == 0", "unknown end (left view, free, lost, end of log) at 'gone', column 21"),
        ("objects where moving > 0 between 1 and 3", "expected nothing more at 'between', column 26"),
        ("objects where change is nothing == 0", "expected null at 'nothing', column 25"),
        ("__import__('os').system('id') == 0", "cannot be read at '.', column 17"),
        ("objects where topic == /nowhere == 0", "cannot be read at '/', column 24"),
    ],
)
def test_mistakes(expression: str, problem: str) -> None:
    with pytest.raises(OptionError) as error:
        parse_check(expression)
    assert str(error.value).startswith(f"--check '{expression}': {problem}")
    assert "\n" not in str(error.value)
    assert error.value.exit_code == 2


def test_an_unknown_figure_names_the_nearest_and_where_all_are() -> None:
    for expression, near in (
        ("sweps >= 1", "; did you mean sweeps?"),
        ("widths.p95 < 1", "; did you mean width.p95, width.p50 or width.p05?"),
        ("xyz < 1", ";"),
    ):
        name = expression.split()[0]
        with pytest.raises(OptionError) as error:
            parse_check(expression)
        assert str(error.value) == (
            f"--check '{expression}': unknown figure '{name}'{near} docs/reports.md has all; at '{name}', column 1"
        )


def test_only_the_columns_that_are_looked_at_are_read() -> None:
    checks = [parse_check("objects where width > 1 or not track is null == 0"), parse_check("sweeps > 3")]
    assert columns_needed(checks, "objects") == {"width", "track"}
    assert columns_needed(checks, "sweeps") == frozenset()


@pytest.mark.parametrize(
    ("expression", "problem"),
    [
        (
            "objects where " + "(" * 3_000,
            f"--check 'objects where {'(' * 186}...': more than {DEEPEST} brackets are open at '(', column 66",
        ),
        (
            "objects where " + "not " * 5_000 + "width > 1 == 0",
            "--check 'objects where not no...': 20,028 characters are more than a check may have (10,000)",
        ),
    ],
)
def test_checks_have_bounds(expression: str, problem: str) -> None:
    with pytest.raises(OptionError) as error:
        parse_check(expression)
    assert str(error.value) == problem
    assert error.value.exit_code == 2
