/* A controller as a shared library for hil-bench: docs/firmware.md.
 *
 * The bench owns the time. It creates an instance, then asks it again and again to live until a moment,
 * hands it the frames that came meanwhile and takes those that it sends. All state belongs to the
 * instance, so that several run side by side, and in several threads. Times are the bench's [ns].
 */
#ifndef HIL_CONTROLLER_H
#define HIL_CONTROLLER_H

#include <stddef.h>
#include <stdint.h>

#define HIL_CONTROLLER_VERSION 1u

enum hil_flags { HIL_EXTENDED = 1, HIL_REMOTE = 2 };

struct hil_frame {
    int64_t time_ns; /* when it was on the bus */
    uint32_t id;     /* 11 bits, or 29 with HIL_EXTENDED */
    uint8_t bus;     /* which of the controller's buses, from 0 */
    uint8_t length;  /* of the data, 0 to 8 */
    uint8_t flags;   /* HIL_EXTENDED, HIL_REMOTE */
    uint8_t reserved;
    uint8_t data[8];
};

enum hil_state {
    HIL_FAILED = -1,  /* cannot go on; hil_controller_message says why */
    HIL_RUNNING = 0,
    HIL_STARTING = 1, /* runs, but has not begun its work: a run in which that does not change failed */
    HIL_ENDED = 2     /* has come to its end in good order */
};

struct hil_controller; /* the library's own */

/* HIL_CONTROLLER_VERSION, as the library was built with. */
uint32_t hil_controller_version(void);

/* Returns an instance that has not begun yet; NULL where it cannot be. `settings` are texts "name=value",
 * behind the last one NULL; they live as long as the call. */
struct hil_controller *hil_controller_create(const char *const *settings);

/* Lives until `until_ns`. `received` came since the call before, in order. Writes at most `room` frames
 * to `sent`, in order of time, and their number to `sent_count`; what does not fit waits for the next
 * call. Returns an hil_state. */
int hil_controller_advance(struct hil_controller *controller, int64_t until_ns,
                           const struct hil_frame *received, size_t received_count,
                           struct hil_frame *sent, size_t room, size_t *sent_count);

/* Returns what it has to say since the last such call, lines ended by \n; "" for nothing. The text
 * lives until the next call of any function with this instance. With NULL: why create failed. */
const char *hil_controller_message(struct hil_controller *controller);

/* Takes its power away and gives it back. */
void hil_controller_reset(struct hil_controller *controller);

void hil_controller_destroy(struct hil_controller *controller);

#endif
