"""From the URL of an object, a folder or a pattern to the logs of a store that it means."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import PurePosixPath

from lidarcli.errors import OptionError, UnreadableError
from lidarcli.pipeline.inputs.files import fixed_part
from lidarcli.pipeline.inputs.opening import hold_one_sweep_each
from lidarcli.pipeline.inputs.search import SUFFIXES, are_one_log, known_suffixes, stem_of
from lidarcli.pipeline.inputs.sources import Nothing, Source
from lidarcli.stores.store import has_bucket, head, is_folder, listing
from lidarcli.stores.url import State, Url, place

Objects = Mapping[Url, State]


def find_stored(text: str) -> list[Source | Nothing]:
    """The logs that a URL means: an object, all below a folder, or those that match a pattern; sorted by name.

    In a pattern `*` and `?` stop at a slash and `**/` stands for any folders. Where listing fails, one `Nothing` says why.
    """
    url = place(text)
    assert isinstance(url, Url)
    try:
        # Not asked of what can only be a folder or a pattern; names may hold brackets.
        if url.key and not text.endswith("/") and "*" not in url.key and (state := head(url)) is not None:
            return [Source(str(url), stem_of(url.name), found=state)]
        if url.has_magic() and ("*" in url.key or not is_folder(url)):
            return _matching(text, url)
        objects = dict(listing(url))
        found = _below(url, objects)
        if not found:
            return [Nothing(text, UnreadableError(_why_none(url, objects)))]
        return found
    except UnreadableError as err:
        return [Nothing(text, UnreadableError(str(err).removeprefix(f"{url}: ")))]


def _why_none(url: Url, objects: Objects) -> str:
    if objects:
        return f"no log in this folder ({known_suffixes()})"
    return "no such object or folder" if has_bucket(url) else "there is no such bucket"


def _below(base: Url, objects: Objects) -> list[Source | Nothing]:
    """All logs below a folder: bags and folders of sweeps, each as one log, and objects by their suffix."""
    folders: dict[str, list[Url]] = {"": []}
    found: dict[PurePosixPath, Source | Nothing] = {}
    for url in objects:
        below = url.key.removeprefix(base.key).strip("/")
        if {".", ".."} & {*below.split("/")} and url.name.lower().endswith(SUFFIXES):
            found[PurePosixPath(below)] = _odd(url, "has a part that is . or ..")
        elif not any(part.startswith(".") for part in below.split("/")):
            folders.setdefault(below.rpartition("/")[0], []).append(url)
    whole: list[str] = []
    for folder, urls in sorted(folders.items()):
        if any(folder == one or folder.startswith(f"{one}/") or not one for one in whole):
            continue
        here = base / folder if folder else base
        if are_one_log(here, [url.name for url in urls]):
            whole.append(folder)
            found[PurePosixPath(folder)] = _of_objects(str(here), folder or base.name, urls, objects)
            continue
        for url in urls:
            if url.name.lower().endswith(SUFFIXES):
                key = PurePosixPath(folder) / url.name
                name = str(key.with_name(stem_of(url.name)))
                found[key] = _source(url, name, objects)
    return [found[key] for key in sorted(found)]


def _matching(text: str, pattern: Url) -> list[Source | Nothing]:
    """The logs that a pattern names, by their places below its part without signs."""
    base, objects = _beside(pattern)
    matches = _matcher(pattern)
    urls = [url for url in objects if matches(url.key)]
    if hold_one_sweep_each([url for url in urls if url.suffix in (".csv", ".tsv", ".txt")]):
        return [_of_objects(str(pattern), urls[0].parent.name, urls, objects)]
    found: dict[str, Source | Nothing] = {}
    # A pattern may also name folders: bags, or some to search; what is in a bag is no log of its own.
    folders = {str(parent) for url in objects for parent in PurePosixPath(url.key).parents} - {".", base.key}
    for folder in sorted(filter(matches, folders)):
        inside = {url: state for url, state in objects.items() if url.key.startswith(f"{folder}/")}
        here = replace(base, key=folder)
        prefix = folder.removeprefix(base.key).strip("/")
        for source in _below(here, inside):
            if isinstance(source, Source):
                name = prefix if source.path == str(here) else f"{prefix}/{source.name}"
                found[source.path] = replace(source, name=name)
            else:
                found[source.path] = source
    in_bags = {file for source in found.values() if isinstance(source, Source) for file in source.files}
    for url in urls:
        below = PurePosixPath(url.key.removeprefix(base.key).strip("/"))
        if str(url) not in found and str(url) not in in_bags:
            found[str(url)] = _source(url, str(below.with_name(stem_of(url.name))), objects)
    if found:
        return [found[path] for path in sorted(found)]
    why = "no object matches this pattern" if objects or has_bucket(pattern) else "there is no such bucket"
    return [Nothing(text, UnreadableError(why))]


def objects_matching(pattern: Url) -> list[Url]:
    """The objects that a pattern names, by name."""
    matches = _matcher(pattern)
    return [url for url in _beside(pattern)[1] if matches(url.key)]


def _beside(pattern: Url) -> tuple[Url, Objects]:
    """The folder up to which a pattern says what it means, and all that is below it."""
    base = replace(pattern, key=fixed_part(pattern.key).strip("/"))
    return base, dict(listing(base))


def _matcher(pattern: Url) -> Callable[[str], bool]:
    parts = pattern.key.split("/")
    return lambda key: _matches(parts, key.split("/"))


def _matches(pattern: Sequence[str], key: Sequence[str]) -> bool:
    """Whether a name is meant by a pattern, part by part as in a shell; no sign stands for the dot of a hidden name."""
    if not pattern:
        return not key
    first, rest = pattern[0], pattern[1:]
    if first == "**":
        more = bool(key) and not key[0].startswith(".") and _matches(pattern, key[1:])
        return more or _matches(rest, key)
    if not key or (key[0].startswith(".") and not first.startswith(".")):
        return False
    return fnmatchcase(key[0], first) and _matches(rest, key[1:])


def _source(url: Url, name: str, objects: Objects) -> Source | Nothing:
    """An object that is a log, if its URL is told from a URL with options."""
    try:
        is_told = place(str(url)) == url
    except OptionError:
        is_told = False
    if not is_told:
        return _odd(url, "has an empty part (//)" if "//" in url.key else "reads like the options of a URL")
    return Source(str(url), name, found=objects[url])


def _odd(url: Url, why: str) -> Nothing:
    """An object whose name stands for no place."""
    return Nothing(str(url), UnreadableError(f"its name {why}; rename the object"))


def _of_objects(path: str, name: str, urls: list[Url], objects: Objects) -> Source:
    """Several objects that are one log."""
    size = sum(objects[url].size for url in urls)
    state = State(size, max(objects[url].mtime_ns for url in urls))
    return Source(path, name, tuple(map(str, urls)), state)
