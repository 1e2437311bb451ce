from lidarcli cimport native


cdef class Columns:
    cdef readonly Py_ssize_t objects, vertices, faces, room_objects, room_vertices, room_faces, beam_width
    cdef readonly bint per_beam, explained
    cdef long long* row
    cdef int* object
    cdef unsigned char* set
    cdef unsigned char* shape
    cdef unsigned char* visibility
    cdef int* beam_i
    cdef int* beam_f
    cdef int* beams
    cdef double* theta_i
    cdef double* theta_f
    cdef double* r_i
    cdef double* r_f
    cdef double* s_i
    cdef double* s_f
    cdef double* d_th
    cdef double* theta_min
    cdef double* r_min
    cdef double* x
    cdef double* y
    cdef double* width
    cdef double* box_x
    cdef double* box_y
    cdef double* box_length
    cdef double* box_width
    cdef double* box_yaw
    cdef double* thing
    cdef double* features
    cdef int* vertex_offsets
    cdef double* vertex_theta
    cdef double* vertex_r
    cdef unsigned char* vertex_kind
    cdef int* face_offsets
    cdef double* face_theta_i
    cdef double* face_theta_f
    cdef double* face_length
    cdef double* face_rms
    cdef double* nearest
    cdef double* nearest_theta
    cdef double* d_mean
    cdef double* sweep_d_th
    cdef double* noise
    cdef int* sweep_objects
    cdef int* object_beams
    cdef int* beam_object
    cdef double* beam_s


cdef bint has_room(Columns columns, Py_ssize_t beams) noexcept nogil
