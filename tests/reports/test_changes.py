"""Changes from run to run in reports and pictures, on tables whose rows are known."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch

from lidarcli.display import palette
from lidarcli.errors import OptionError, UnreadableError
from lidarcli.formalism.mapping.grid import FREE, OCCUPIED, UNKNOWN, Occupancy
from lidarcli.pipeline.inputs.tables import find_table_sets, find_tables, table_files
from lidarcli.pipeline.reporting import FORMATS, ReportOptions, make_report, render
from lidarcli.reports.changes import changes_part
from lidarcli.reports.drawing import Labels, project_style
from lidarcli.reports.map_picture import Backdrop, changes_figure
from lidarcli.reports.run import RunPart
from lidarcli.reports.run_pairs import pairs_of
from lidarcli.tabular.schemas import CHANGES
from lidarcli.tabular.writing import ALIGNMENT, CHANGE_FIGURES, DAMAGE
from tests.reports.runs import crossing, made, table, write_run
from tests.reports.test_labels import meet


def change(thing: int, status: str, log_b: str = "tuesday", **other: Any) -> dict[str, Any]:
    """A row of the table: `a` and `b` are x, y and yaw in the runs."""
    row = {"log_a": "monday", "log_b": log_b, "thing": thing, "kind": "thing", "status": status}
    row |= {"score": 0.95, "length": 0.6, "width": 0.4}
    for run in "ab":
        if (place := other.pop(run, None)) is not None:
            row |= dict(zip((f"x_{run}", f"y_{run}", f"yaw_{run}"), place, strict=True))
    return row | other


ROWS = [
    change(1, "known", a=(1.0, 1.0, 0.0), b=(1.04, 1.0, 0.0), label="bin"),
    change(2, "moved", a=(0.0, 0.0, 0.0), b=(0.0, 1.5, 0.5), moved=1.5, turned=0.5),
    change(3, "gone", a=(-1.5, 1.0, 0.0)),
    change(4, "new", b=(-1.5, -1.0, 0.3), kind="structure", length=1.8, width=0.1, score=0.9),
    change(5, "uncertain", a=(1.5, -1.0, 0.0), why="hidden", score=0.5, length=None, width=None),
    change(6, "known", "wednesday", a=(1.0, 1.0, 0.0), b=(1.0, 1.0, 0.0)),
    change(7, "gone", "wednesday", log_a="tuesday", a=(0.0, 1.5, 0.5)),
]
ALIGNMENTS = [
    {"log_a": "monday", "log_b": "tuesday", "dx": 0.3, "dy": -0.4, "dyaw": 0.5, "overlap": 0.93, "rms": 0.02},
    {"log_a": "tuesday", "log_b": "wednesday", "dx": 0, "dy": 0, "dyaw": 0, "overlap": 0.98, "rms": 0.01},
]
FIGURES = {"known": 2, "moved": 1, "new": 1, "gone": 2, "uncertain": 1, "overlap": 0.93}


def told(
    rows: Sequence[Mapping[str, Any]] = ROWS,
    alignments: Sequence[Mapping[str, Any]] = ALIGNMENTS,
    figures: Mapping[str, Any] = FIGURES,
    damage: Sequence[str] = (),
) -> pa.Table:
    """A table of changes with its metadata."""
    metadata = {ALIGNMENT: alignments, CHANGE_FIGURES: figures} | ({DAMAGE: damage} if damage else {})
    return table(CHANGES, rows).replace_schema_metadata({key: json.dumps(value) for key, value in metadata.items()})


def written(path: Path, *args: Any, **options: Any) -> Path:
    path.parent.mkdir(exist_ok=True)
    pq.write_table(told(*args, **options), path)
    return path


def lines_of(text: str) -> list[str]:
    return [" ".join(line.split()) for line in text.splitlines()]


def test_runs_of_a_table() -> None:
    first, second = pairs_of(told())
    assert (first.title, second.title) == ("monday to tuesday", "tuesday to wednesday")
    assert first.counts == {"known": 1, "moved": 1, "new": 1, "gone": 1, "uncertain": 1}
    assert second.words == "known 1, gone 1"
    assert [one.thing for one in second.changes] == [6, 7]
    assert first.line == (
        "monday to tuesday: known 1, moved 1, new 1, gone 1, uncertain 1; 93.0 % of the structure in place, "
        "0.50 m and 28.6 degrees apart"
    )


def test_figures_are_those_of_diff() -> None:
    assert changes_part([("c.parquet", told())]).figures == FIGURES
    both = changes_part([("a.parquet", told()), ("b.parquet", told())]).figures
    assert both == FIGURES | {"known": 4, "moved": 2, "new": 2, "gone": 4, "uncertain": 2}


def test_what_diff_could_not_count_stays_unknown() -> None:
    short = dict.fromkeys(FIGURES) | {"overlap": 0.93}
    changed = changes_part([("c.parquet", told(figures=short))])
    assert changed.figures == short
    assert changes_part([("a", told()), ("b", told(figures=short))]).figures["gone"] is None


def test_figures_of_two_maps_are_those_of_one_table() -> None:
    of_maps = {"precision": 0.9, "recall": None, "f1": 0.8}
    found = told(figures=FIGURES | of_maps)
    assert changes_part([("c", found)]).figures == FIGURES | of_maps
    assert "f1" not in changes_part([("c", found), ("d", found)]).figures


def test_without_metadata_the_rows_tell_the_runs() -> None:
    changed = changes_part([("c", told().replace_schema_metadata(None))])
    assert [one.title for one in changed.pairs] == ["monday to tuesday", "monday to wednesday"]
    assert changed.figures == FIGURES | {"overlap": None}


def test_a_report_on_changes_alone_in_every_format(tmp_path: Path) -> None:
    path = written(tmp_path / "site.changes.parquet")
    checks = ["gone == 2", "new == 0", "overlap > 0.9", "f1 > 0.9"]
    for named in (path, tmp_path, tmp_path / "*.parquet"):
        found = made(named, checks=checks)
        assert not isinstance(found.parts[0], RunPart)
        assert [(one.found, one.holds) for one in found.verdicts] == [(2, True), (1, False), (0.93, True), (None, False)]
        assert found.exit_code == 1
    text = render(found, "text")
    assert max(map(len, text.splitlines())) <= 80
    rows = lines_of(text)
    for row in (
        "from to known moved new gone uncertain overlap",
        "monday tuesday 1 1 1 1 1 93.0 %",
        "tuesday wednesday 1 0 0 1 0 98.0 %",
        "thing status detail score size place kind",
        "2 moved by 1.50 m, 29° 0.95 0.6 x 0.4 m (0.0, 1.5) thing",
        "4 new 0.90 1.8 x 0.1 m (-1.5, -1.0) structure",
        "5 uncertain hidden 0.50 (1.5, -1.0) thing",
        "1 known 0.95 0.6 x 0.4 m (1.0, 1.0) thing, bin",
        "monday tuesday 0.30 m -0.40 m 28.6° 0.020 m",
    ):
        assert row in rows
    first = rows.index("thing status detail score size place kind")
    assert [row.split()[1] for row in rows[first + 1 : first + 6]] == ["moved", "new", "gone", "uncertain", "known"]
    markdown = render(found, "markdown")
    assert "| monday | tuesday | 1 | 1 | 1 | 1 | 1 | 93.0 % |" in markdown
    assert "| 5 | uncertain | hidden | 0.50 |  | (1.5, -1.0) | thing |" in markdown
    values = json.loads(render(found, "json"))
    assert values["schema"] == "lidarcli.changes/1"
    assert values["figures"] == FIGURES
    assert values["alignments"] == ALIGNMENTS
    assert values["changes"][6] == {
        "log_b": "wednesday", "thing": 7, "kind": "thing", "status": "gone", "why": None, "score": 0.95,
        "x_a": 0, "y_a": 1.5, "yaw_a": 0.5, "x_b": None, "y_b": None, "yaw_b": None, "moved": None,
        "turned": None, "length": 0.6, "width": 0.4, "label": None,
    }  # fmt: skip
    junit = render(found, "junit")
    assert '<property name="gone" value="2" />' in junit
    assert 'message="expected == 0, found 1"' in junit
    github = render(found, "github")
    assert "::error title=lidarcli%3A check failed::new == 0: expected == 0, found 1" in github
    assert "tuesday to wednesday: known 1, gone 1; 98.0 %25 of the structure in place" in github
    assert found.lines[-1] in " ".join(render(found, "text", brief=True).split())


@pytest.mark.slow
def test_the_page_draws_each_run(tmp_path: Path) -> None:
    page = render(made(written(tmp_path / "site.changes.parquet")), "html")
    assert page.count("<svg ") == 2
    first, second = page.split("<svg ")[1:]
    assert "monday to tuesday" in first
    assert "known 1, moved 1, new 1, gone 1, uncertain 1" in first
    assert "tuesday to wednesday" in second
    # Colours follow the page, patterns are those of their own drawing.
    assert "var(--vermilion)" in first
    assert "var(--blue)" in first
    assert palette.VERMILION.lower() not in first.lower()
    assert 'id="cChangesofrun1-' in first
    assert 'id="cChangesofrun1-' not in second
    assert "moved 1, new 1, gone 2, uncertain 1, known 2, 93.0 % of the structure in place" in page


@pytest.mark.slow
def test_changes_beside_objects_join_the_report(tmp_path: Path) -> None:
    objects = write_run(tmp_path, **crossing())
    path = written(tmp_path / "site.changes.parquet")
    found = made(objects, path, checks=["gone == 2", "sweeps == 10"], viewer=True)
    assert isinstance(found.parts[0], RunPart)
    assert found.holds
    assert found.figures["gone"] == 2
    assert "tuesday to wednesday: known 1, gone 1; 98.0 % of the structure in place" in "\n".join(found.lines)
    for kind in FORMATS:
        assert ("gone" if kind == "junit" else "wednesday") in render(found, kind)
    page = render(found, "html")
    assert 'aria-label="Changes of run 2"' in page
    values = json.loads(render(found, "json"))
    assert values["schema"] == "lidarcli.report/1"
    assert (values["figures"]["sweeps"], values["figures"]["gone"]) == (10, 2)
    assert len(values["changes"]) == 7
    # A folder holds both.
    assert made(tmp_path).figures["gone"] == 2
    alone = json.loads(render(made(objects), "json"))
    assert not {"changes", "alignments"} & {*alone}


def test_most_changes_are_counted_alone(tmp_path: Path) -> None:
    rows = [change(k, "known", a=(0.1 * k, 0.0, 0.0), b=(0.1 * k, 0.0, 0.0)) for k in range(1, 31)]
    rows[-1] |= {"status": "gone", "x_b": None}
    text = render(made(written(tmp_path / "c.changes.parquet", rows)), "text")
    assert "and 18 more, all of them in the table of changes" in text
    assert "30 gone 0.95 0.6 x 0.4 m (3.0, 0.0) thing" in lines_of(text)


def test_a_table_that_is_named_itself_may_have_any_name(tmp_path: Path) -> None:
    path = written(tmp_path / "monday-tuesday.parquet")
    assert find_tables([str(path)]).changes == [path]
    assert table_files([str(path)]) == [path]
    assert made(path, checks=["gone == 2"]).holds
    # In a folder the name tells.
    with pytest.raises(UnreadableError, match=r"no \*.objects.parquet in this folder"):
        made(tmp_path)
    pairs, problems = find_table_sets([str(path)])
    assert not pairs
    assert "this is the changes table of lidarcli diff" in str(problems[0])


@pytest.mark.parametrize(
    ("check", "message"),
    [
        ("gon == 0", "unknown figure 'gon'; did you mean gone"),
        ("delta.gone == 0", "unknown figure 'delta.gone'"),
        ("sweeps > 3", "unknown figure 'sweeps'"),
        ("objects where width > 1 == 0", "unknown figure 'objects'"),
    ],
)
def test_mistakes_in_checks_of_changes(tmp_path: Path, check: str, message: str) -> None:
    path = written(tmp_path / "c.changes.parquet")
    with pytest.raises(OptionError) as caught:
        made(path, checks=[check])
    assert message in str(caught.value)


def test_checks_of_changes_need_their_table(tmp_path: Path) -> None:
    objects = write_run(tmp_path, **crossing())
    with pytest.raises(OptionError, match=r"asks for changes, and no table of them is named; lidarcli diff A B"):
        made(objects, checks=["gone == 0"])


def test_what_a_report_on_changes_alone_refuses(tmp_path: Path) -> None:
    path = str(written(tmp_path / "c.changes.parquet"))
    for options, name in (
        (ReportOptions((path,), logs=("run.mcap",)), "--log"),
        (ReportOptions((path,), baseline=(str(write_run(tmp_path / "b", **crossing())),)), "--baseline"),
    ):
        with pytest.raises(OptionError, match=f"{name}: these are tables of changes alone"):
            make_report(options)


def test_tables_of_changes_that_cannot_be_read(tmp_path: Path) -> None:
    whole = written(tmp_path / "a.changes.parquet")
    odd = written(tmp_path / "b.changes.parquet", [change(1, "vanished", a=(0.0, 0.0, 0.0))])
    report = made(whole, odd, checks=["gone == 2"])
    assert report.exit_code == 3
    assert "b.changes.parquet: column status holds 'vanished'; it can be one of known, moved" in report.unread[0]
    for name, data in (("c.changes.parquet", b"PAR1"), ("d.parquet", b"")):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(UnreadableError, match=name):
            made(tmp_path / name)
    pq.write_table(told().drop_columns(["why"]), tmp_path / "e.changes.parquet")
    with pytest.raises(UnreadableError, match=r"not a table of lidarcli diff: no column why"):
        made(tmp_path / "e.changes.parquet")


def test_checks_see_only_a_part_of_damaged_runs(tmp_path: Path) -> None:
    path = written(tmp_path / "c.changes.parquet", damage=["tuesday.mcap: chunk 3: cut"])
    report = made(path, checks=["gone == 2"])
    assert report.exit_code == 3
    assert "tuesday.mcap: chunk 3: cut" in report.unseen[0]
    assert made(path).exit_code == 0


def ground() -> Occupancy:
    """A room of 8 x 6 m in the middle of unseen cells; the near side of thing 1 is hit."""
    cells = np.full((400, 400), UNKNOWN, np.int8)
    cells[140:260, 120:280] = FREE
    cells[140, 120:280] = cells[259, 120:280] = OCCUPIED
    # From (0.7, 0.7) to (1.3, 0.75).
    cells[214, 214:226] = OCCUPIED
    return Occupancy(0.05, -10.0, -10.0, cells, "map")


def figure(rows: Sequence[Mapping[str, Any]] = ROWS, grounds: bool = True) -> Figure:
    pairs = pairs_of(told(rows))
    sensors = np.column_stack([np.linspace(-1.0, 1.0, 50), np.zeros(50)])
    sights = [Backdrop(ground(), sensors), Backdrop(ground(), sensors[:1])] if grounds else [Backdrop(), Backdrop()]
    with project_style({"axes.grid": False, "figure.dpi": 60}):
        found = changes_figure(pairs, sights)
        found.canvas.draw()  # type: ignore[no-untyped-call]
    return found


@pytest.fixture(scope="module")
def drawn() -> Figure:
    return figure()


def boxes(axes: Axes) -> list[PathPatch]:
    return [patch for patch in axes.patches if isinstance(patch, PathPatch)]


def middle(box: PathPatch) -> tuple[float, float]:
    (corners,) = box.get_path().to_polygons()
    return tuple(0.5 * (np.min(corners, axis=0) + np.max(corners, axis=0)))


def test_a_panel_for_each_run(drawn: Figure) -> None:
    first, second = drawn.axes
    assert first.get_title("left") == ("monday to tuesday\nknown 1, moved 1, new 1, gone 1, uncertain 1")
    assert second.get_title("left") == "tuesday to wednesday\nknown 1, gone 1"
    # One scale and one place for all, without the unseen margin of the ground.
    assert first.get_xlim() == second.get_xlim() == pytest.approx((-4.5, 4.5))
    assert (first.get_xlabel(), first.get_aspect()) == ("x [m]", 1.0)
    # Panels of such a room stand side by side.
    assert first.get_position().y0 == pytest.approx(second.get_position().y0)


def test_boxes_have_the_colours_of_their_status_and_their_place(drawn: Figure) -> None:
    first, second = drawn.axes
    found = {tuple(np.round(middle(box), 2)): colour_of(box) for box in boxes(first)}
    assert found[(0.0, 1.5)] == palette.GREEN
    assert found[(0.0, 0.0)] == palette.GREEN
    assert found[(-1.5, 1.0)] == palette.BLUE
    assert found[(-1.5, -1.0)] == palette.VERMILION
    assert found[(1.5, -1.0)] == palette.PURPLE
    [hatched] = [box for box in boxes(first) if box.get_hatch()]
    assert middle(hatched) == pytest.approx((1.5, -1.0))
    [arrow] = [line.get_xydata().tolist() for line in first.lines if line.get_color() == palette.GREEN][:1]
    assert arrow == [[0.0, 0.0], [0.0, 1.5]]
    assert len(boxes(second)) == 2


def colour_of(box: PathPatch) -> str:
    red, green, blue, _ = (round(255 * part) for part in box.get_edgecolor())
    return f"#{red:02X}{green:02X}{blue:02X}"


def test_every_thing_has_its_number(drawn: Figure) -> None:
    first, second = drawn.axes
    for axes, numbers in ((first, ["2", "4", "3", "5", "1"]), (second, ["7", "6"])):
        [labels] = [artist for artist in axes.artists if isinstance(artist, Labels)]
        assert [one.text for one in labels.labels] == numbers
        places = labels.places
        assert len(places) == len(numbers)
        assert not any(meet(one, other) for k, one in enumerate(places) for other in places[:k])


def test_the_legend_is_whole(drawn: Figure) -> None:
    [legend] = drawn.legends
    assert [text.get_text() for text in legend.get_texts()] == [
        *("structure before", "free before", "unseen before"),
        *("known", "moved", "new", "gone", "uncertain", "sensor of the later run"),
    ]
    [legend] = figure(grounds=False).legends
    assert [text.get_text() for text in legend.get_texts()] == ["known", "moved", "new", "gone", "uncertain"]


@pytest.mark.slow
def test_things_without_a_place_are_left_out() -> None:
    axes = figure([change(1, "known"), change(2, "moved", b=(1.0, 1.0, 0.0))], grounds=False).axes[0]
    assert [middle(box) for box in boxes(axes)] == [pytest.approx((1.0, 1.0))]


@pytest.mark.slow
def test_many_runs_are_no_wider_than_a_few() -> None:
    rows = [change(k, "gone", f"run {k}", a=(0.1 * k, 0.0, 0.0)) for k in range(1, 31)]
    pairs = pairs_of(told(rows, []))
    with project_style({"axes.grid": False}):
        found = changes_figure(pairs, [Backdrop()] * 30)
    assert len(found.axes) == 30
    assert found.get_size_inches()[0] <= 24.0 + 0.7 * math.ceil(math.sqrt(30 * 4))
