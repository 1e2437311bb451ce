cimport cython

from lidarcli cimport native

cdef double INFINITY


cdef class Assignment:
    cdef list owner
    cdef readonly Py_ssize_t most_columns
    cdef public Py_ssize_t rows, columns
    cdef double* cost
    cdef Py_ssize_t* column
    cdef double* row_price
    cdef double* column_price
    cdef Py_ssize_t* taken_by
    cdef Py_ssize_t* before
    cdef double* least
    cdef Py_ssize_t* done


cdef void solve(Assignment task, double without) noexcept nogil
@cython.locals(step=double, next_at=Py_ssize_t, cost=double, i=Py_ssize_t, at=Py_ssize_t)
cdef void _augment(Assignment task, Py_ssize_t row, Py_ssize_t wide, double without) noexcept nogil
