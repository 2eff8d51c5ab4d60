/* The controller as a library for hil-bench: an instance is the whole program on a stack of its own,
 * which is left wherever it waits for a frame or for its time (hil_controller.h, docs/firmware.md).
 */
#include "hil_controller.h"
#include "platform.h"
#include "position_control.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <ucontext.h>

#define EXPORT __attribute__((visibility("default")))
#define STACK_BYTES (128 * 1024)
#define MOST_FRAMES 512
#define MOST_TEXT 2048

struct queue {
    struct hil_frame frames[MOST_FRAMES];
    size_t first, count;
};

struct hil_controller {
    struct options options;
    struct report report;
    struct queue in, out;
    ucontext_t host, own;
    char *stack;
    int64_t now_ns, wake_ns;
    bool is_alive, has_begun;
    enum outcome outcome;
    char text[MOST_TEXT], shown[MOST_TEXT];
    size_t length;
};

static _Thread_local struct hil_controller *running;
static _Thread_local char refusal[128];

static bool push(struct queue *queue, const struct hil_frame *frame)
{
    if (queue->count == MOST_FRAMES)
        return false;
    queue->frames[(queue->first + queue->count++) % MOST_FRAMES] = *frame;
    return true;
}

static bool pop(struct queue *queue, struct hil_frame *frame)
{
    if (queue->count == 0)
        return false;
    *frame = queue->frames[queue->first];
    queue->first = (queue->first + 1) % MOST_FRAMES;
    queue->count--;
    return true;
}

/* The platform of the instance that runs. */

int64_t platform_now_us(void)
{
    return running->now_ns / 1000;
}

static void keep_text(const char *format, va_list arguments)
{
    size_t room = MOST_TEXT - running->length;
    int length = vsnprintf(running->text + running->length, room, format, arguments);

    if (length > 0)
        running->length += (size_t)length < room ? (size_t)length : room - 1;
}

void platform_warn(const char *format, ...)
{
    va_list arguments;

    va_start(arguments, format);
    keep_text(format, arguments);
    va_end(arguments);
}

void platform_tell(const char *format, ...)
{
    va_list arguments;

    va_start(arguments, format);
    keep_text(format, arguments);
    va_end(arguments);
}

bool can_bus_open(struct can_bus *bus, const char *name)
{
    (void)bus, (void)name;
    return true;
}

void can_bus_close(struct can_bus *bus)
{
    (void)bus;
}

bool can_bus_flush(struct can_bus *bus)
{
    (void)bus;
    return true;
}

bool can_bus_send(struct can_bus *bus, const struct frame *frame)
{
    struct hil_frame sent = {.time_ns = running->now_ns, .id = frame->id, .length = frame->length};

    (void)bus;
    memcpy(sent.data, frame->data, sizeof sent.data);
    return push(&running->out, &sent);
}

enum receive_result can_bus_receive(struct can_bus *bus, struct frame *frame, int64_t timeout_us)
{
    struct hil_controller *self = running;
    struct hil_frame received;

    (void)bus;
    self->wake_ns = (platform_now_us() + timeout_us) * 1000;
    while (!pop(&self->in, &received)) {
        if (self->now_ns >= self->wake_ns)
            return RECEIVE_NOTHING;
        swapcontext(&self->own, &self->host);
    }
    *frame = (struct frame){.id = (uint16_t)received.id, .length = received.length};
    memcpy(frame->data, received.data, sizeof frame->data);
    return RECEIVE_FRAME;
}

/* The six functions. */

static bool is_interrupted(void)
{
    return false;
}

static void live(void)
{
    struct hil_controller *self = running;

    self->outcome =
        position_control(&self->options, &self->report, is_interrupted, &self->has_begun);
    self->is_alive = false;
    swapcontext(&self->own, &self->host); /* for good */
}

static bool is_for_us(const struct hil_frame *frame)
{
    return frame->flags == 0 && frame->bus == 0;
}

static int state(const struct hil_controller *self)
{
    if (self->is_alive)
        return self->has_begun ? HIL_RUNNING : HIL_STARTING;
    return self->outcome == DONE ? HIL_ENDED : HIL_FAILED;
}

EXPORT uint32_t hil_controller_version(void)
{
    return HIL_CONTROLLER_VERSION;
}

EXPORT void hil_controller_reset(struct hil_controller *self)
{
    memset(&self->in, 0, sizeof self->in);
    memset(&self->out, 0, sizeof self->out);
    memset(&self->report, 0, sizeof self->report);
    self->has_begun = false;
    self->is_alive = true;
    self->wake_ns = 0;
    getcontext(&self->own);
    self->own.uc_stack.ss_sp = self->stack;
    self->own.uc_stack.ss_size = STACK_BYTES;
    self->own.uc_link = NULL;
    makecontext(&self->own, live, 0);
}

/* "targets_mm=50" to the option targets-mm. */
static bool read_setting(struct options *options, const char *setting)
{
    const char *value = strchr(setting, '=');
    char name[32] = "";

    if (value == NULL || (size_t)(value - setting) >= sizeof name)
        return false;
    memcpy(name, setting, (size_t)(value - setting));
    for (char *c = name; *c != '\0'; c++)
        if (*c == '_')
            *c = '-';
    return set_option(options, name, value + 1);
}

EXPORT struct hil_controller *hil_controller_create(const char *const *settings)
{
    struct hil_controller *self = calloc(1, sizeof *self);

    snprintf(refusal, sizeof refusal, "no memory");
    if (self == NULL || (self->stack = malloc(STACK_BYTES)) == NULL) {
        free(self);
        return NULL;
    }
    self->options = default_options();
    self->options.bus = "library";
    for (; *settings != NULL; settings++)
        if (!read_setting(&self->options, *settings)) {
            snprintf(refusal, sizeof refusal, "%s: is no setting of it; targets_mm, speed_mm_s, "
                     "dwell_ms and period_us are", *settings);
            hil_controller_destroy(self);
            return NULL;
        }
    if (self->options.target_count == 0) {
        snprintf(refusal, sizeof refusal, "has no target; give targets_mm = \"50,-50\"");
        hil_controller_destroy(self);
        return NULL;
    }
    hil_controller_reset(self);
    return self;
}

EXPORT int hil_controller_advance(struct hil_controller *self, int64_t until_ns,
                                  const struct hil_frame *received, size_t received_count,
                                  struct hil_frame *sent, size_t room, size_t *sent_count)
{
    for (size_t i = 0; i < received_count; i++)
        if (is_for_us(&received[i]))
            push(&self->in, &received[i]); /* a full buffer loses frames, as that of a chip does */
    running = self;
    while (self->is_alive && (self->in.count > 0 || self->wake_ns <= until_ns)) {
        if (self->in.count == 0 && self->wake_ns > self->now_ns)
            self->now_ns = self->wake_ns;
        swapcontext(&self->host, &self->own);
    }
    self->now_ns = until_ns;
    for (*sent_count = 0; *sent_count < room && pop(&self->out, &sent[*sent_count]);)
        (*sent_count)++;
    return state(self);
}

EXPORT const char *hil_controller_message(struct hil_controller *self)
{
    if (self == NULL)
        return refusal;
    memcpy(self->shown, self->text, sizeof self->shown);
    self->shown[self->length] = '\0';
    self->length = 0;
    return self->shown;
}

EXPORT void hil_controller_destroy(struct hil_controller *self)
{
    free(self->stack);
    free(self);
}
