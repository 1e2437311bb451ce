"""What native.py does, for the compiled modules: memory, and the interpreter lock."""

from cpython.buffer cimport PyBUF_SIMPLE, PyBuffer_Release, PyObject_GetBuffer

cdef extern from "Python.h":
    ctypedef struct PyThreadState:
        pass
    PyThreadState* PyEval_SaveThread() nogil
    void PyEval_RestoreThread(PyThreadState* state) nogil


cdef inline void* room(list owner, Py_ssize_t size) except NULL:
    """Zeroed memory that lives as long as its owner."""
    cdef bytearray memory = bytearray(size if size > 0 else 1)
    owner.append(memory)
    return <void*> <char*> memory


cdef inline double* doubles(list owner, Py_ssize_t count) except NULL:
    return <double*> room(owner, count * sizeof(double))


cdef inline Py_ssize_t* integers(list owner, Py_ssize_t count) except NULL:
    return <Py_ssize_t*> room(owner, count * sizeof(Py_ssize_t))


cdef inline int* numbers(list owner, Py_ssize_t count) except NULL:
    return <int*> room(owner, count * sizeof(int))


cdef inline float* singles(list owner, Py_ssize_t count) except NULL:
    return <float*> room(owner, count * sizeof(float))


cdef inline void* start(object values, Py_ssize_t size) except NULL:
    """Where the elements of an array begin, each of which takes `size` bytes."""
    cdef Py_buffer view
    cdef void* begin
    PyObject_GetBuffer(values, &view, PyBUF_SIMPLE)
    begin = view.buf
    cdef Py_ssize_t itemsize = view.itemsize
    PyBuffer_Release(&view)
    if itemsize != size:
        raise TypeError(f"elements of {itemsize} bytes in place of {size}")
    return begin


cdef inline double* at_doubles(object values) except NULL:
    return <double*> start(values, 8)


cdef inline float* at_singles(object values) except NULL:
    return <float*> start(values, 4)


cdef inline long long* at_longs(object values) except NULL:
    return <long long*> start(values, 8)


cdef inline int* at_ints(object values) except NULL:
    return <int*> start(values, 4)


cdef inline unsigned char* at_bytes(object values) except NULL:
    return <unsigned char*> start(values, 1)


cdef inline PyThreadState* release() noexcept:
    return PyEval_SaveThread()


cdef inline void resume(PyThreadState* state) noexcept:
    PyEval_RestoreThread(state)


# The struct `Pointers`, and `pointers`, which fills it: setup.py writes them from the fields of `Detection`.
include "pointers.pxi"
