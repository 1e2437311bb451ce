/* The least that a program could take: read an MCAP of sensor_msgs/msg/LaserScan, decompress its chunks (zstd), touch each beam.
   Prints how many sweeps there are and the sum of their finite ranges. Compiled by bench.py, without headers of zstd. */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

size_t ZSTD_decompress(void *to, size_t room, const void *from, size_t size);

static long sweeps;
static double sum;

static int u16(const unsigned char *at) { return at[0] | at[1] << 8; }
static uint32_t u32(const unsigned char *at) { uint32_t value; memcpy(&value, at, 4); return value; }
static uint64_t u64(const unsigned char *at) { uint64_t value; memcpy(&value, at, 8); return value; }

/* CDR: 4 bytes of encapsulation; a stamp, frame_id, 7 floats, ranges, aligned from there on. */
static void touch(const unsigned char *data) {
    const unsigned char *body = data + 4, *beams = body + (12 + u32(body + 8) + 3) / 4 * 4 + 28;
    float each = 0, range;
    for (uint32_t n = 1; n <= u32(beams); n++) {
        memcpy(&range, beams + 4 * n, 4);
        if (isfinite(range)) each += range;
    }
    sum += each;
    sweeps++;
}

/* Records: 1 byte of kind, 8 of length; a message's header has 22 bytes. */
static void walk(const unsigned char *at, const unsigned char *end) {
    static unsigned char *plain;
    static size_t room;
    static int schema = -1, channel = -1;
    while (at + 9 <= end) {
        unsigned kind = at[0];
        const unsigned char *record = at + 9;
        at = record + u64(record - 8);
        if (kind == 3 && !memcmp(record + 6, "sensor_msgs/msg/LaserScan", 25)) schema = u16(record);
        if (kind == 4 && u16(record + 2) == schema) channel = u16(record);
        if (kind == 5 && u16(record) == channel) touch(record + 22);
        if (kind != 6) continue;
        size_t size = u64(record + 16);
        const unsigned char *packed = record + 40 + u32(record + 28);
        if (size > room && !(plain = realloc(plain, room = size))) exit(1);
        if (ZSTD_decompress(plain, size, packed, u64(packed - 8)) != size) exit(1);
        walk(plain, plain + size);
    }
}

int main(int count, char **words) {
    FILE *file = count > 1 ? fopen(words[1], "rb") : NULL;
    if (!file || fseek(file, 0, SEEK_END)) return 1;
    size_t size = ftell(file);
    unsigned char *data = malloc(size);
    rewind(file);
    if (!data || fread(data, 1, size, file) != size) return 1;
    walk(data + 8, data + size);
    printf("%ld %.6g\n", sweeps, sum);
}
