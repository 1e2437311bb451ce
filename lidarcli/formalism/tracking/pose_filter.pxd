cimport cython
cimport libc.math as math

from lidarcli.system cimport native
from lidarcli.formalism.tracking.kalman cimport Targets
from lidarcli.formalism.tracking.measurement cimport Measurements

cdef Py_ssize_t LIVE, AHEAD, DELAY, LEFT
cdef double MOUNT_VAR, MOUNT_TURN_VAR
cdef double DELAY_SD, MIN_DELAY_VAR, MIN_PLACE_VAR, MAX_DELAY, MAX_POSE_RESIDUAL, PLACE_SD, POSE_SIDE_VAR


cdef class PoseErrorFilter:
    cdef list owner
    cdef double* value
    cdef double* cov
    cdef readonly Py_ssize_t sensors
    cdef double* last
    cdef double* elapsed
    cdef double speed_x, speed_y, turning
    cdef public double travelled
    cdef double* jacobian
    cdef double* product
    cdef double* change

    cpdef tuple estimate(self)


@cython.locals(sensor=Py_ssize_t)
cdef void pass_time(PoseErrorFilter pose_error, double dt) noexcept nogil
cdef void correct_pose(PoseErrorFilter pose_error, Measurements meas, double x, double y, double yaw, double side) noexcept nogil
cdef void set_jacobian(PoseErrorFilter pose_error, Measurements meas, double x, double y, double u_x, double u_y, Py_ssize_t axis
) noexcept nogil
cdef void update_pose_error(PoseErrorFilter pose_error, Targets targets, Py_ssize_t a, double off, double var, Py_ssize_t axis
) noexcept nogil
cdef void mix_jacobian(PoseErrorFilter pose_error, Targets targets, Py_ssize_t a, double gain, Py_ssize_t axis) noexcept nogil
cdef void apply_pose_error(PoseErrorFilter pose_error, Targets targets) noexcept nogil
