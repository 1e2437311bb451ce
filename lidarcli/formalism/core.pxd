cimport cython

from lidarcli.system cimport native
from lidarcli.formalism cimport description, features, objects, range_noise, segmentation, surfaces, verdict
from lidarcli.formalism.description cimport Columns, Description
from lidarcli.formalism.features cimport Features
from lidarcli.formalism.verdict cimport Verdict
from lidarcli.formalism.objects cimport Bodies, Protrusions
from lidarcli.formalism.range_noise cimport Noise
from lidarcli.formalism.segmentation cimport Breakpoints, Points, Scans, Segments
from lidarcli.formalism.surfaces cimport Faces, Survey

cdef double NAN


cdef class Core:
    cdef bint robust, adaptive, by_mean, report_walls
    cdef double threshold, group_gap
    cdef Points points
    cdef Noise noise
    cdef Breakpoints breakpoints
    cdef Segments segments
    cdef Faces faces
    cdef Survey survey
    cdef Protrusions protrusions
    cdef Bodies bodies
    cdef Features features
    cdef Verdict verdict
    cdef Description description
    cdef list owner
    cdef Py_ssize_t* inner

    cpdef Py_ssize_t detect(self, Scans scans, Columns columns, Py_ssize_t row) except -1
    cpdef measure_noise(self, Scans scans, object sigma)
    cpdef measure_differences(self, Scans scans, object s)
    cpdef measure_breakpoints(self, Scans scans, object d_th, object breaks)


cdef void write_noise(Core core, Scans scans, double* out) noexcept nogil
cdef void write_all_differences(Core core, Scans scans, double* out) noexcept nogil
cdef void write_differences(Points points, Scans scans, double* out) noexcept nogil
cdef void write_all_breakpoints(Core core, Scans scans, double* d_th, unsigned char* breaks) noexcept nogil
cdef double break_row(Core core, Scans scans, Py_ssize_t row) noexcept nogil
cdef void detect_row(Core core, Scans scans, Columns columns, Py_ssize_t row) noexcept nogil
cdef void _as_printed(Core core, Scans scans) noexcept nogil
cdef void _take_mask(Core core, Scans scans) noexcept nogil
cdef void _within_mask(Core core, Scans scans) noexcept nogil
cdef void _as_sensors_need(Core core, Scans scans) noexcept nogil
cdef void _settle(Core core) noexcept nogil
@cython.locals(body=Py_ssize_t, value=double)
cdef void _explain(Core core, Columns columns) noexcept nogil
