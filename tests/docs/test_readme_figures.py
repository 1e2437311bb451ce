"""The figures of README.md are those of the pages that benchmarks write."""

from __future__ import annotations

import re

import pytest

from tests.places import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
SECTION = " ".join(README.partition("\n## How good it is\n")[2].partition("\n## ")[0].split())
ACCURACY = (ROOT / "docs" / "accuracy.md").read_text(encoding="utf-8").partition("<!-- real recordings: begin -->")[2]
PERFORMANCE = (ROOT / "docs" / "performance.md").read_text(encoding="utf-8")
SCORES = {
    name.strip("*"): (float(recall), float(precision))
    for name, precision, recall in re.findall(
        r"^\| (\S.*?) \| (0\.\d{3}) \([^|]*\) \| (0\.\d{3}) \(", ACCURACY, re.MULTILINE
    )
}
"""Method → recall and precision on real logs."""
PUBLISHED = ("fixed 0.3 m", "0.1 m + 0.00628 r", "Dietmayer", "Borges & Aldon", "DBSCAN(0.3, 3)")


def told(pattern: str) -> list[float]:
    """Return the numbers of a sentence of the section."""
    found = re.search(pattern, SECTION)
    assert found is not None, pattern
    return [float(number.replace(",", "")) for number in found.groups()]


def f1(method: str) -> float:
    recall, precision = SCORES[method]
    return 2 * recall * precision / (recall + precision)


def test_the_speed_is_that_of_the_benchmark() -> None:
    (measured,) = re.findall(r"^\| room, detect \| [\d.]+ \| ([\d,]+) \|", PERFORMANCE, re.MULTILINE)
    (about,) = told(r"about ([\d,]+) sweeps of 361 beams per second on two cores")
    assert about == pytest.approx(float(measured.replace(",", "")), rel=0.1)
    (measured,) = re.findall(r"^\| moving, track \| [\d.]+ \| ([\d,]+) \|", PERFORMANCE, re.MULTILINE)
    (about,) = told(r"`track` about ([\d,]+)")
    assert about == pytest.approx(float(measured.replace(",", "")), rel=0.1)


@pytest.mark.parametrize(
    ("method", "pattern"),
    [
        ("track", r"`track`, whose constants .*, has (\d+) % and (\d+) %"),
        ("detect", r"`detect`, .*, has a recall of (\d+) % and a precision of (\d+) %"),
        (max(PUBLISHED, key=f1), r"the best of five published segmentations has (\d+) % and (\d+) %"),
    ],
)
def test_the_accuracy_is_that_of_the_page(method: str, pattern: str) -> None:
    for percent, measured in zip(told(pattern), SCORES[method], strict=True):
        # The page rounds to three digits what the README rounds to two.
        assert abs(percent - 100 * measured) < 0.56


def test_the_logs_are_those_of_the_page() -> None:
    sentence = r"(\d+) sweeps of (\d+) public recordings"
    found = re.search(sentence, ACCURACY)
    assert found is not None
    assert told(sentence) == [float(number) for number in found.groups()]
