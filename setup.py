"""The compiled kernels, which are optional: where no compiler is at hand the package installs without them.

With `LIDARCLI_BUILD=required`, as for wheels, it does not.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from Cython.Build import cythonize
from setuptools import Extension, setup

# No fused multiply-add: it would round differently from numpy, whose results the kernels repeat bit for bit. Exception
# flags and errno, which nobody asks for, keep compilers from using vector instructions.
FLAGS = (
    ["/O2"]
    if sys.platform == "win32"
    else ["-O3", "-g0", "-ffp-contract=off", "-fno-trapping-math", "-fno-math-errno"]
)

# For those who look for a wild index; `make bounds` sets it, in a copy of the tree.
BOUNDS = bool(os.environ.get("LIDARCLI_BOUNDS"))

kernels = cythonize(
    [
        Extension(f"lidarcli.kernels.{path.stem}", [str(path)], extra_compile_args=FLAGS)
        for path in sorted(Path("lidarcli/kernels").glob("*.pyx"))
    ],
    # C files count as up to date whatever they were made with: each kind has a folder of its own.
    build_dir="build/bounds" if BOUNDS else "build",
    force=BOUNDS,
    language_level=3,
    compiler_directives={
        "boundscheck": BOUNDS,
        "wraparound": False,
        "cdivision": True,
        "initializedcheck": False,
    },
)
for kernel in kernels:
    # Said here, as Cython makes extensions of its own, which forget it.
    kernel.optional = os.environ.get("LIDARCLI_BUILD") != "required"

setup(ext_modules=kernels, options={"build_ext": {"parallel": os.cpu_count() or 1, "force": BOUNDS}})
