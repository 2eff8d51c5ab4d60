#include "can_bus.h"

#include <errno.h>
#include <net/if.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#ifdef __linux__
#include <linux/can.h>
#include <linux/can/raw.h>
#endif

#define ANSWER_TIMEOUT_US 5000000
#define MAX_ID 0x7FF

static bool complain(const char *name, const char *reason)
{
    fprintf(stderr, "firmware: bus %s: %s\n", name, reason);
    return false;
}

#ifdef __linux__
static bool open_socketcan(struct can_bus *bus, const char *name)
{
    struct ifreq request = {0};
    struct sockaddr_can address = {.can_family = AF_CAN};

    if (strlen(name) >= sizeof request.ifr_name)
        return complain(name, "an interface's name is shorter; 127.0.0.1:29536 names a hub");
    memcpy(request.ifr_name, name, strlen(name));
    bus->fd = socket(PF_CAN, SOCK_RAW, CAN_RAW);
    if (bus->fd < 0)
        return complain(name, "this kernel has no CAN sockets; 127.0.0.1:29536 names a hub");
    if (ioctl(bus->fd, SIOCGIFINDEX, &request) < 0)
        return complain(name, strerror(errno));
    address.can_ifindex = request.ifr_ifindex;
    if (bind(bus->fd, (struct sockaddr *)&address, sizeof address) < 0)
        return complain(name, strerror(errno));
    return true;
}

static bool send_socketcan(struct can_bus *bus, const struct frame *frame)
{
    struct can_frame raw = {.can_id = frame->id, .can_dlc = frame->length};
    ssize_t sent;

    memcpy(raw.data, frame->data, frame->length);
    do {
        sent = write(bus->fd, &raw, sizeof raw);
        if (sent < 0 && errno == ENOBUFS) { /* the transmit queue is full: wait for room */
            struct pollfd room = {.fd = bus->fd, .events = POLLOUT};
            poll(&room, 1, 1);
        }
    } while (sent < 0 && (errno == EINTR || errno == ENOBUFS));
    return sent == (ssize_t)sizeof raw;
}

static enum receive_result receive_socketcan(struct can_bus *bus, struct frame *frame)
{
    struct can_frame raw;
    ssize_t got = recv(bus->fd, &raw, sizeof raw, MSG_DONTWAIT);

    if (got < 0)
        return errno == EAGAIN || errno == EINTR ? RECEIVE_NOTHING : RECEIVE_LOST;
    if (got != (ssize_t)sizeof raw || raw.can_dlc > 8 || raw.can_id > MAX_ID)
        return RECEIVE_NOTHING; /* a 29-bit identifier, a remote or an error frame */
    frame->id = (uint16_t)raw.can_id;
    frame->length = raw.can_dlc;
    memcpy(frame->data, raw.data, sizeof frame->data);
    return RECEIVE_FRAME;
}
#else
static bool open_socketcan(struct can_bus *bus, const char *name)
{
    (void)bus;
    return complain(name, "SocketCAN is Linux's; 127.0.0.1:29536 names a hub");
}

static bool send_socketcan(struct can_bus *bus, const struct frame *frame)
{
    (void)bus;
    (void)frame;
    return false;
}

static enum receive_result receive_socketcan(struct can_bus *bus, struct frame *frame)
{
    (void)bus;
    (void)frame;
    return RECEIVE_LOST;
}
#endif

/* The raw mode of the socketcand protocol: github.com/linux-can/socketcand, doc/protocol.md */

static enum receive_result wait_readable(int fd, int64_t timeout_us)
{
    struct pollfd source = {.fd = fd, .events = POLLIN};
    int64_t left_us = timeout_us > 0 ? timeout_us : 0;
    struct timespec timeout = {left_us / 1000000, left_us % 1000000 * 1000};
    int ready = ppoll(&source, 1, &timeout, NULL);

    if (ready < 0)
        return errno == EINTR ? RECEIVE_NOTHING : RECEIVE_LOST;
    return ready ? RECEIVE_FRAME : RECEIVE_NOTHING;
}

/* Takes the next message, "< ... >"; NULL where there is no whole one. */
static char *next_message(struct can_bus *bus)
{
    char *start = bus->in + bus->in_start;
    char *end = memchr(start, '>', bus->in_end - bus->in_start);

    if (end == NULL)
        return NULL;
    *end = '\0';
    bus->in_start = (size_t)(end + 1 - bus->in);
    return start + strspn(start, " ");
}

/* Reads more of what the hub says; false when the bus is lost. */
static bool read_more(struct can_bus *bus)
{
    ssize_t got;

    memmove(bus->in, bus->in + bus->in_start, bus->in_end - bus->in_start);
    bus->in_end -= bus->in_start;
    bus->in_start = 0;
    got = recv(bus->fd, bus->in + bus->in_end, sizeof bus->in - bus->in_end, MSG_DONTWAIT);
    if (got < 0)
        return errno == EAGAIN || errno == EINTR;
    bus->in_end += (size_t)got;
    return got > 0; /* 0: closed by the hub, or a message without an end */
}

static bool expect(struct can_bus *bus, const char *answer)
{
    char *message;

    while ((message = next_message(bus)) == NULL)
        if (wait_readable(bus->fd, ANSWER_TIMEOUT_US) != RECEIVE_FRAME || !read_more(bus))
            return false;
    return strncmp(message, answer, strlen(answer)) == 0;
}

static bool say(struct can_bus *bus, const char *command)
{
    size_t length = strlen(command);

    if (bus->out_length + length > sizeof bus->out && !can_bus_flush(bus))
        return false;
    memcpy(bus->out + bus->out_length, command, length);
    bus->out_length += length;
    return true;
}

static int connect_to(const char *host, const char *port)
{
    struct addrinfo hints = {.ai_socktype = SOCK_STREAM};
    struct addrinfo *found = NULL;
    int fd = -1, on = 1;

    if (getaddrinfo(host, port, &hints, &found) != 0)
        return -1;
    for (struct addrinfo *at = found; at != NULL && fd < 0; at = at->ai_next) {
        fd = socket(at->ai_family, at->ai_socktype, at->ai_protocol);
        if (fd >= 0 && connect(fd, at->ai_addr, at->ai_addrlen) < 0) {
            close(fd);
            fd = -1;
        }
    }
    freeaddrinfo(found);
    if (fd >= 0)
        setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    return fd;
}

static bool open_hub(struct can_bus *bus, const char *name)
{
    char host[64], port[8], channel[16] = "can0", command[32];

    if (sscanf(name, "%63[^:]:%7[0-9]/%15s", host, port, channel) < 2)
        return complain(name, "HOST:PORT or HOST:PORT/CHANNEL is right");
    bus->is_hub = true;
    bus->fd = connect_to(host, port);
    if (bus->fd < 0)
        return complain(name, "nobody answers there; 'hil-bench run --hub' makes a bus");
    snprintf(command, sizeof command, "< open %s >", channel);
    if (!expect(bus, "< hi") || !say(bus, command) || !can_bus_flush(bus) || !expect(bus, "< ok"))
        return complain(name, "the hub does not open that channel");
    if (!say(bus, "< rawmode >") || !can_bus_flush(bus) || !expect(bus, "< ok"))
        return complain(name, "the hub has no raw mode");
    return true;
}

static bool send_hub(struct can_bus *bus, const struct frame *frame)
{
    char command[64];
    int length = snprintf(command, sizeof command, "< send %03X %u ", frame->id, frame->length);

    for (int i = 0; i < frame->length; i++)
        length += snprintf(command + length, sizeof command - (size_t)length, "%02X ",
                           frame->data[i]);
    memcpy(command + length, ">", 2);
    return say(bus, command);
}

/* Reads "< frame 181 12.345678 0700DEAD "; false where it is anything else. */
static bool parse_frame(const char *message, struct frame *frame)
{
    char id[9], digits[17] = "";

    if (sscanf(message, "< frame %8[0-9A-Fa-f] %*[0-9.] %16[0-9A-Fa-f]", id, digits) < 1)
        return false;
    if (strlen(id) != 3 || strlen(digits) % 2 != 0)
        return false;
    memset(frame, 0, sizeof *frame);
    frame->id = (uint16_t)strtoul(id, NULL, 16);
    frame->length = (uint8_t)(strlen(digits) / 2);
    for (int i = 0; i < frame->length; i++) {
        const char byte[] = {digits[2 * i], digits[2 * i + 1], '\0'};
        frame->data[i] = (uint8_t)strtoul(byte, NULL, 16);
    }
    return true;
}

static enum receive_result receive_hub(struct can_bus *bus, struct frame *frame)
{
    char *message;

    while ((message = next_message(bus)) != NULL)
        if (parse_frame(message, frame))
            return RECEIVE_FRAME;
    return RECEIVE_NOTHING;
}

bool can_bus_open(struct can_bus *bus, const char *name)
{
    memset(bus, 0, sizeof *bus);
    bus->fd = -1;
    return strchr(name, ':') ? open_hub(bus, name) : open_socketcan(bus, name);
}

bool can_bus_send(struct can_bus *bus, const struct frame *frame)
{
    return bus->is_hub ? send_hub(bus, frame) : send_socketcan(bus, frame);
}

bool can_bus_flush(struct can_bus *bus)
{
    size_t done = 0;

    while (done < bus->out_length) {
        ssize_t sent = send(bus->fd, bus->out + done, bus->out_length - done, MSG_NOSIGNAL);
        if (sent < 0 && errno != EINTR)
            return false;
        done += sent > 0 ? (size_t)sent : 0;
    }
    bus->out_length = 0;
    return true;
}

enum receive_result can_bus_receive(struct can_bus *bus, struct frame *frame, int64_t timeout_us)
{
    enum receive_result result;

    if (bus->is_hub && receive_hub(bus, frame) == RECEIVE_FRAME)
        return RECEIVE_FRAME;
    result = wait_readable(bus->fd, timeout_us);
    if (result != RECEIVE_FRAME)
        return result;
    if (!bus->is_hub)
        return receive_socketcan(bus, frame);
    return read_more(bus) ? receive_hub(bus, frame) : RECEIVE_LOST;
}

void can_bus_close(struct can_bus *bus)
{
    if (bus->fd >= 0)
        close(bus->fd);
    bus->fd = -1;
}
