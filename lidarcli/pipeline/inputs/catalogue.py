"""Catalogues of known objects (TOML)."""

from __future__ import annotations

from os import PathLike, fspath

from lidarcli.errors import OptionError
from lidarcli.files.configfiles import Fields, read_toml
from lidarcli.formalism.detection import MAX_INTENSITY
from lidarcli.formalism.matching.catalogue import KINDS as THING_SHAPES
from lidarcli.formalism.matching.catalogue import Catalogue, Thing
from lidarcli.pipeline.inputs.masks import numbered

MAX_THING = 100.0
"""[m] No object of interest is larger."""
SIZES = {
    "prismatic": (("length", "width"),),
    "round": (("diameter",),),
    "legged": (("legs", "spacing"),),
    "irregular": (("length", "width"), ("diameter",)),
}
"""Shape → the keys of its size, one group or another."""
ALL_SIZES = (("length", "width"), ("diameter",), ("legs", "spacing"))


def read_catalogue(path: str | PathLike[str]) -> Catalogue:
    """Read a catalogue; whatever is wrong with it is one line that names the file, the thing and the key.

    Raises
    ------
    UnreadableError
        There is no such file, or it is no TOML.
    OptionError
        An entry does not say what a thing is.
    """
    file = fspath(path)
    top = Fields(file, "the catalogue", read_toml(file, "catalogue"))
    tables = numbered(top, "thing")
    top.done()
    if not tables:
        raise OptionError(f"{file}: no [[thing]] in this catalogue")
    things: dict[str, Thing] = {}
    for fields in tables:
        thing = _thing(fields)
        fields.done()
        if thing.name in things:
            first = [*things].index(thing.name) + 1
            fields.fail("name", f"is '{thing.name}' as that of number {first}: names must be unique")
        things[thing.name] = thing
    return Catalogue(tuple(things.values()), path=file)


def _thing(fields: Fields) -> Thing:
    """Return the object of one entry. Unknown keys are refused before missing ones: they may be misspelt."""
    name = fields.text("name")
    shape = fields.text("shape", choices=THING_SHAPES) if fields.has("shape") else None
    keys = [key for group in ALL_SIZES for key in group]
    given = [key for key in keys if fields.has(key)]
    is_lit = fields.has("intensity_min", "intensity_max")
    fields.has("tolerance", "moves")
    fields.done()
    group = _size_keys(fields, shape, given) if given or not is_lit else ()
    length = width = diameter = None
    legs = 0
    spacing: tuple[float, ...] = ()
    if group == ("length", "width"):
        length, width = (fields.number(key, above=0, high=MAX_THING) for key in group)
    elif group == ("diameter",):
        diameter = fields.number("diameter", above=0, high=MAX_THING)
    elif group:
        legs = fields.whole("legs", low=2, high=8)
        spacing = _spacing(fields, legs)
    least, most = (
        fields.number(key, low=0, high=MAX_INTENSITY, largest=MAX_INTENSITY) if fields.has(key) else None
        for key in ("intensity_min", "intensity_max")
    )
    if least is not None and most is not None and least > most:
        fields.fail("intensity_min", f"is above intensity_max: {least:g} and {most:g}")
    return Thing(
        name=name,
        shape=shape,
        length=length,
        width=width,
        diameter=diameter,
        legs=legs,
        spacing=spacing,
        tolerance=fields.number("tolerance", 0.02, low=0, high=MAX_THING),
        moves=fields.flag("moves", True),
        intensity_min=least,
        intensity_max=most,
    )


def _size_keys(fields: Fields, shape: str | None, given: list[str]) -> tuple[str, ...]:
    """Return the keys of the size of an object: all of one group that its shape has, and no others."""
    groups = ALL_SIZES if shape is None else SIZES[shape]
    of = f"a {shape} thing" if shape != "irregular" else "an irregular thing"
    of = "a thing" if shape is None else of
    choices = ", or ".join(" and ".join(group) for group in groups)
    if not given:
        fields.fail(groups[0][0], f"is missing: the size of {of} is {choices}")
    group = next((group for group in groups if given[0] in group), None)
    if group is None:
        fields.fail(given[0], f"is no size of {of}: that is {choices}")
    for key in given:
        if key not in group:
            fields.fail(key, f"and '{given[0]}' exclude each other: the size of {of} is {choices}")
    for key in group:
        if key not in given:
            fields.fail(key, f"is missing: the size of {of} is {choices}")
    return group


def _spacing(fields: Fields, legs: int) -> tuple[float, ...]:
    """Return the distances of the axes of the legs: one of two legs, two of more."""
    spacing = fields.numbers("spacing", above=0, high=MAX_THING)
    wanted = 1 if legs == 2 else 2
    if len(spacing) != wanted:
        of = "two legs is one number, as [0.3]" if wanted == 1 else "more legs is two numbers, as [0.55, 0.45]"
        fields.fail("spacing", f"of {of}")
    return tuple(spacing)
