"""The compiled kernels, which are optional: where no compiler is at hand the package installs without them."""

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

setup(
    ext_modules=cythonize(
        [
            Extension(f"lidarcli.kernels.{path.stem}", [str(path)], extra_compile_args=FLAGS, optional=True)
            for path in sorted(Path("lidarcli/kernels").glob("*.pyx"))
        ],
        build_dir="build",
        language_level=3,
        compiler_directives={
            # For those who look for a wild index: LIDARCLI_BOUNDS=1 pip install --editable .
            "boundscheck": bool(os.environ.get("LIDARCLI_BOUNDS")),
            "wraparound": False,
            "cdivision": True,
            "initializedcheck": False,
        },
    ),
    options={"build_ext": {"parallel": os.cpu_count() or 1}},
)
