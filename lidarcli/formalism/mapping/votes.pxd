cimport cython

from lidarcli cimport native
from lidarcli.formalism.mapping cimport rays


cdef Py_ssize_t SURFACE, NOTHING


@cython.locals(
    rows=Py_ssize_t, width=Py_ssize_t, row=Py_ssize_t, at=Py_ssize_t, k=Py_ssize_t, body=Py_ssize_t, _=Py_ssize_t
)
cpdef own(ranges, beams, first, stop, beam_i, beam_f, double step, owner)
@cython.locals(
    sweeps=Py_ssize_t, width=Py_ssize_t, across=Py_ssize_t, sweep=Py_ssize_t, k=Py_ssize_t, cell=Py_ssize_t,
    line=Py_ssize_t, along=Py_ssize_t, last=Py_ssize_t, body=Py_ssize_t
)
cpdef cast(
    end, owner, vote, long long building, odds, votes, double resolution, Py_ssize_t column, Py_ssize_t row
)
@cython.locals(
    sweeps=Py_ssize_t, width=Py_ssize_t, across=Py_ssize_t, sweep=Py_ssize_t, k=Py_ssize_t, cell=Py_ssize_t,
    high=Py_ssize_t, along=Py_ssize_t, last=Py_ssize_t, body=Py_ssize_t, beside=Py_ssize_t, near=Py_ssize_t
)
cpdef poll(
    end, owner, odds, votes, line, double resolution, Py_ssize_t column, Py_ssize_t row, found
)
