from lidarcli.formalism.segmentation cimport Points, Segments


cdef void mark(Points points, Segments segments, Py_ssize_t* inner, Py_ssize_t* extremum) noexcept nogil
