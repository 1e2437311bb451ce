"""What is packed: one version, one list of requirements and one set of bounds in all files that say so."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest
from packaging.metadata import Metadata
from packaging.requirements import Requirement

from lidarcli import __version__
from tests.places import ROOT
from tests.publishing.files import PROJECT, misfits, read_yaml
from tools.changelog import section
from tools.fuzz import judge

RECIPE = read_yaml(ROOT / "conda" / "recipe.yaml")
CITATION = read_yaml(ROOT / "CITATION.cff")
CONDA_NAMES = {"matplotlib": "matplotlib-base"}
"""PyPI's name → conda-forge's, where they differ."""


def tracked() -> list[str]:
    """The files of the project as git knows them; skips where this is no checkout."""
    done = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip("this is no checkout of git")
    return [name for name in done.stdout.splitlines() if (ROOT / name).exists()]


def conda(requirements: list[str]) -> list[str]:
    """Requirements of pyproject.toml as the recipe words them."""
    parsed = [Requirement(each) for each in requirements]
    return [f"{CONDA_NAMES.get(each.name, each.name)} {each.specifier}" for each in parsed]


def test_every_file_has_the_same_version() -> None:
    assert RECIPE["context"]["version"] == CITATION["version"] == __version__
    example = re.findall(r"lidarcli/lidarcli@v(\S+)", (ROOT / "docs" / "ci.md").read_text("utf-8"))
    assert {*example} == {__version__}


def test_the_citation_is_valid_and_names_the_paper() -> None:
    assert misfits(ROOT / "CITATION.cff", "vendor.citation-file-format") == ""
    paper = CITATION["preferred-citation"]
    readme = (ROOT / "README.md").read_text("utf-8")
    assert paper["doi"] == "10.3390/s24072284"
    assert f"https://doi.org/{paper['doi']}" in readme
    assert f"Sensors {paper['year']}, {paper['volume']}, {paper['start']}" in " ".join(readme.split())
    assert paper["title"].partition(":")[0] in " ".join(readme.split())
    assert [author["family-names"] for author in paper["authors"]] == [
        "Fagundes",
        "Caldeira",
        "Quemelli",
        "Martins",
        "Brandão",
    ]


def test_the_changelog_has_what_the_release_of_this_version_says() -> None:
    text = (ROOT / "CHANGELOG.md").read_text("utf-8")
    assert "\n### Added\n" in section(__version__, text)
    with pytest.raises(ValueError, match=r"no heading `## \[9.9.9\]"):
        section("9.9.9", text)
    with pytest.raises(ValueError, match=r"nothing stands below `## \[9.9.8\]`"):
        section("9.9.8", "## [9.9.8] - 2030-01-01\n\n## [9.9.7] - 2029-01-01\n\n- Old.\n")


@pytest.fixture(scope="module")
def sdist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The source distribution, built of the tracked files by the backend itself, unpacked."""
    folder = tmp_path_factory.mktemp("sdist")
    for name in tracked():
        (folder / "tree" / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, folder / "tree" / name)
    build = "import sys; from setuptools import build_meta; build_meta.build_sdist(sys.argv[1])"
    # What is translated on the way is of no use here, and takes minutes.
    quick = "import Cython.Build as b; b.cythonize = lambda modules, **_: []; " + build
    done = subprocess.run(
        [sys.executable, "-c", quick, folder], cwd=folder / "tree", capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    (archive,) = folder.glob("*.tar.gz")
    assert archive.name == f"lidarcli-{__version__}.tar.gz"
    with tarfile.open(archive) as packed:
        packed.extractall(folder / "unpacked", filter="data")
    return folder / "unpacked" / f"lidarcli-{__version__}"


@pytest.mark.slow
def test_the_source_distribution_holds_what_is_tracked(sdist: Path) -> None:
    packed = {path.relative_to(sdist).as_posix() for path in sdist.rglob("*") if path.is_file()}
    made = {name for name in packed if name in ("PKG-INFO", "setup.cfg") or ".egg-info/" in name}
    left_out = {".git-blame-ignore-revs", ".gitignore", ".ci/run"}
    assert packed - made == set(tracked()) - left_out


@pytest.mark.slow
def test_the_metadata_is_what_pypi_accepts(sdist: Path) -> None:
    told = Metadata.from_email((sdist / "PKG-INFO").read_bytes(), validate=True)
    assert (told.name, str(told.version)) == ("lidarcli", __version__)
    assert told.license_expression == "Apache-2.0"
    assert told.description_content_type == "text/markdown"
    assert told.project_urls == PROJECT["project"]["urls"]
    assert [str(each) for each in told.requires_dist or [] if "extra" not in str(each.marker)] == [
        str(Requirement(each)) for each in PROJECT["project"]["dependencies"]
    ]


PAGE = (ROOT / "SECURITY.md").read_text("utf-8")


def test_the_fuzzer_holds_what_is_promised() -> None:
    said = re.search(r"inputs below (\d+) MB to (\d+) s of processor time and (\d+) MB of memory", " ".join(PAGE.split()))
    assert said is not None
    assert [float(number) for number in said.groups()] == [judge.SMALL / 1e6, judge.SECONDS, judge.PEAK_MB]


def test_what_is_unpickled_comes_from_its_own_processes() -> None:
    """But for what a cluster answers, which Dask reads."""
    package = ROOT / "lidarcli"
    files = {
        word: {path.relative_to(package).as_posix() for path in package.rglob("*.py") if word in path.read_text("utf-8")}
        for word in ("pickle.load", "Unpickler")
    }
    own = {"pipeline/mapping.py", "pipeline/objects/tracking.py"}
    assert files == {"pickle.load": own, "Unpickler": set()}
    assert "a scheduler that you trust" in " ".join(PAGE.split())
    assert "a private folder below the temporary one (`map --jobs`)" in " ".join(PAGE.split())
    assert "a temporary file without a name (`track`" in " ".join(PAGE.split())


def test_reports_load_nothing_from_elsewhere() -> None:
    page = (ROOT / "lidarcli" / "reports" / "templates" / "page.html").read_text("utf-8")
    assert "Content-Security-Policy" in page
    assert "default-src 'none'" in page
