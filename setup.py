"""The compiled core, which is optional: where no compiler is at hand the same files run as plain Python.

Every module of the package that has a `.pxd` file beside it is compiled.
With `LIDARCLI_BUILD=required`, as for wheels, a build without it fails.
"""

from __future__ import annotations

import ast
import multiprocessing
import os
import sys
import sysconfig
from pathlib import Path

from Cython.Build import cythonize
from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext

# No fused multiply-add, so that every machine gives the same bits. Exception flags and errno, which nobody asks for,
# keep compilers from using vector instructions.
FLAGS = ["/O2"] if sys.platform == "win32" else ["-O3", "-g0", "-ffp-contract=off", "-fno-trapping-math", "-fno-math-errno"]

# One build for every Python from 3.11 on: the loops touch no Python object, so it is as fast as one for each. Without the
# interpreter lock there is no such thing yet.
STABLE = not sysconfig.get_config_var("Py_GIL_DISABLED")
MACROS = [("Py_LIMITED_API", "0x030B0000"), ("CYTHON_LIMITED_API", "1")] if STABLE else []

KINDS = {
    "Int8": "signed char",
    "UInt8": "unsigned char",
    "Int32": "int",
    "Int64": "long long",
    "Float32": "float",
    "Float64": "double",
}
"""Type of the arrays in a field of a record → the type of a number in C."""


def pointers() -> str:
    """Return what the loops see of a `Detection`: a struct with a pointer for each array, and what fills it.

    Only the source is read: numpy is not there when the package is built.
    """
    source = Path("lidarcli/formalism/detection.py").read_text(encoding="utf-8")
    [record] = [node for node in ast.parse(source).body if isinstance(node, ast.ClassDef) and node.name == "Detection"]
    fields = {
        ast.unparse(node.target): KINDS[ast.unparse(node.annotation).removesuffix(" | None")]
        for node in record.body
        if isinstance(node, ast.AnnAssign)
    }
    lines = ["ctypedef struct Pointers:"]
    lines += [f"    {kind}* {name}" for name, kind in fields.items()]
    lines += ["", "cdef inline Pointers pointers(dict arrays) except *:", "    cdef Pointers found"]
    for name, kind in fields.items():
        start = f"<{kind}*> start(arrays['{name}'], sizeof({kind}))"
        lines.append(f"    found.{name} = {start} if '{name}' in arrays else NULL")
    return "\n".join([*lines, "    return found", ""])


include = Path("build", "pointers.pxi")
if not include.exists() or include.read_text(encoding="utf-8") != pointers():
    include.parent.mkdir(exist_ok=True)
    include.write_text(pointers(), encoding="utf-8")

sources = [path.with_suffix(".py") for path in sorted(Path("lidarcli").rglob("*.pxd")) if path.stem != "native"]
# A module knows the sizes of the classes of those it stands on, however far below: where a .pxd file or the struct has
# changed, all are translated again.
written = [Path("build", path).with_suffix(".c") for path in sources]
generated = [path.stat().st_mtime for path in written if path.exists()]
changed = max(path.stat().st_mtime for path in (include, *Path("lidarcli").rglob("*.pxd")))
modules = cythonize(
    [
        Extension(
            ".".join(path.with_suffix("").parts),
            [str(path)],
            extra_compile_args=FLAGS,
            define_macros=MACROS,
            py_limited_api=STABLE,
        )
        for path in sources
    ],
    build_dir="build",
    include_path=["build"],
    force=changed > min(generated, default=0.0),
    # Where processes are forked, and do not run this script once more.
    nthreads=(os.cpu_count() or 1) if multiprocessing.get_start_method() == "fork" else 0,
    language_level=3,
    compiler_directives={
        # The types stand in the .pxd files: annotations are for readers and for the type checker.
        "annotation_typing": False,
        "infer_types": True,
        "boundscheck": False,
        "wraparound": False,
        "cdivision": True,
        # Nobody pickles a sweep at work, nor reads the C files: half of their lines.
        "auto_pickle": False,
        "emit_code_comments": False,
    },
)
for module in modules:
    # Said here, as Cython makes extensions of its own, which forget it.
    module.optional = os.environ.get("LIDARCLI_BUILD") != "required"


class BuildAllOrNone(build_ext):
    """Compiled modules call each other without Python between them: where one could not be compiled, all are left out."""

    def run(self) -> None:
        """Compile, and remove what is of no use by itself."""
        super().run()
        built = [Path(self.get_ext_fullpath(module.name)) for module in self.extensions]
        built += [Path(self.build_lib, self.get_ext_filename(module.name)) for module in self.extensions]
        there = sum(path.exists() for path in built[: len(self.extensions)])
        if there < len(self.extensions):
            for path in built:
                path.unlink(missing_ok=True)


setup(
    ext_modules=modules,
    cmdclass={"build_ext": BuildAllOrNone},
    options={"build_ext": {"parallel": os.cpu_count() or 1}, "bdist_wheel": {"py_limited_api": "cp311"} if STABLE else {}},
)
