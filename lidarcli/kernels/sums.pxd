"""Sums in the order in which numpy adds, so that results agree to the last bit."""


cdef inline double pairwise(const double* a, Py_ssize_t n) noexcept nogil:
    """Sum of n adjacent values, as numpy adds them."""
    cdef double r0, r1, r2, r3, r4, r5, r6, r7, total
    cdef Py_ssize_t i, half
    if n < 8:
        total = -0.0
        for i in range(n):
            total += a[i]
        return total
    if n <= 128:
        r0, r1, r2, r3, r4, r5, r6, r7 = a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7]
        i = 8
        while i < n - n % 8:
            r0 += a[i]
            r1 += a[i + 1]
            r2 += a[i + 2]
            r3 += a[i + 3]
            r4 += a[i + 4]
            r5 += a[i + 5]
            r6 += a[i + 6]
            r7 += a[i + 7]
            i += 8
        total = ((r0 + r1) + (r2 + r3)) + ((r4 + r5) + (r6 + r7))
        while i < n:
            total += a[i]
            i += 1
        return total
    half = n // 2
    half -= half % 8
    return pairwise(a, half) + pairwise(a + half, n - half)


cdef inline double reduced(const double* a, Py_ssize_t n) noexcept nogil:
    """Sum of n >= 1 adjacent values, as `np.add.reduceat` adds those of a span."""
    return a[0] + pairwise(a + 1, n - 1) if n > 1 else a[0]
