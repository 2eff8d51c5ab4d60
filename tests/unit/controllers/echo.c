/* Sends back what it hears, on the other bus; macros make it do wrong. */
#include "hil_controller.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
struct hil_controller { int64_t now; int calls; };
uint32_t hil_controller_version(void) { return VERSION; }
struct hil_controller *hil_controller_create(const char *const *settings)
{
    return settings[0] && strcmp(settings[0], "side=left") ? NULL : calloc(1, 16);
}
int hil_controller_advance(struct hil_controller *self, int64_t until, const struct hil_frame *in,
                           size_t count, struct hil_frame *out, size_t room, size_t *sent)
{
    *sent = 0;
#ifdef LEAVES
    exit(0);
#endif
#ifdef HANGS
    if (until >= 50000000) {
        fputs("hangs\n", stderr);
        while (until)
            self->calls++;
    }
#endif
#ifdef PRINTS
    puts("one line");
    fflush(stdout);
#endif
    if (self->calls++ == 0)
        return HIL_STARTING;
    for (size_t i = 0; i < count && i < room; i++) {
        out[i] = in[i];
        int64_t time = self->now + (int64_t)i;
        out[i].time_ns = time < until ? time : until;
        out[i].bus ^= 1;
        if (in[i].id == 0x7FE)
            out[i].length = 9;
        if (in[i].id == 0x7FF)
            return in[i].length ? HIL_FAILED : HIL_ENDED;
        *sent = i + 1;
    }
    self->now = until;
    return HIL_RUNNING;
}
const char *hil_controller_message(struct hil_controller *self)
{
    return self ? "one\ntwo\n" : "side: left is right";
}
void hil_controller_reset(struct hil_controller *self) { memset(self, 0, 16); }
#ifndef NO_DESTROY
void hil_controller_destroy(struct hil_controller *self) { free(self); }
#endif
