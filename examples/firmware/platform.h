/* The ground that the controller stands on, beside its bus: a clock, and somebody who listens.
 *
 * platform.c and can_bus.c are those of a program for Linux, library.c is both for hil-bench's kind
 * `library` (docs/firmware.md).
 */
#ifndef PLATFORM_H
#define PLATFORM_H

#include <stdint.h>

/* Time of a clock that is never set [us]. */
int64_t platform_now_us(void);

/* Says what has gone wrong, and what is worth to be known; lines, as for printf. */
void platform_warn(const char *format, ...) __attribute__((format(printf, 1, 2)));
void platform_tell(const char *format, ...) __attribute__((format(printf, 1, 2)));

#endif
