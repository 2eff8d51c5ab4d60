/* NETLINK_ROUTE, as far as programs ask it for CAN interfaces: libraries that read an interface's
 * state, and `ip link set can0 up type can bitrate 500000` in scripts.
 *
 * A socket is one end of a pair; each request is answered at once from the other end.
 */
#include "netlink.h"

#include <linux/can.h>
#include <linux/if.h>
#include <linux/rtnetlink.h>
#include <sys/socket.h>
#include <unistd.h>

#define ARPHRD_CAN_ 280 /* of linux/if_arp.h, which stands against linux/if.h */
#define QUEUE_LENGTH 10
#define MOST_LINKS 16
#define REQUEST_SIZE 4096
#define ANSWER_SIZE 256

static struct link {
    int fd, peer; /* fd 0 where it is free */
} links[MOST_LINKS];

static struct link *link_at(int fd)
{
    for (int i = 0; fd > 0 && i < MOST_LINKS; i++)
        if (links[i].fd == fd)
            return &links[i];
    return NULL;
}

bool is_link(int fd)
{
    return link_at(fd) != NULL;
}

void forget_link(int fd)
{
    struct link *link = link_at(fd);

    if (link == NULL)
        return;
    REAL(close)(link->peer);
    link->fd = 0;
}

int open_link(int flags)
{
    struct link *free = NULL;
    int ends[2];

    for (int i = 0; i < MOST_LINKS; i++)
        if (links[i].fd == 0)
            free = &links[i];
    if (free == NULL) {
        errno = EMFILE;
        return -1;
    }
    if (open_pair(flags, ends) < 0)
        return -1;
    *free = (struct link){ends[0], ends[1]};
    return ends[0];
}

void name_link(int is_own, void *name, socklen_t *length)
{
    const struct sockaddr_nl address = {.nl_family = AF_NETLINK,
                                        .nl_pid = is_own ? (uint32_t)getpid() : 0};

    if (name != NULL)
        memcpy(name, &address, *length < sizeof address ? *length : sizeof address);
    *length = sizeof address;
}

static void add(struct nlmsghdr *message, unsigned short type, const void *data, size_t size)
{
    struct rtattr *attribute =
        (struct rtattr *)((char *)message + NLMSG_ALIGN(message->nlmsg_len));

    attribute->rta_type = type;
    attribute->rta_len = (unsigned short)RTA_LENGTH(size);
    memcpy(RTA_DATA(attribute), data, size);
    message->nlmsg_len = (uint32_t)(NLMSG_ALIGN(message->nlmsg_len) + RTA_SPACE(size));
}

static void answer(const struct link *link, struct nlmsghdr *message,
                   const struct nlmsghdr *request)
{
    message->nlmsg_seq = request->nlmsg_seq;
    message->nlmsg_pid = (uint32_t)getpid();
    REAL(send)(link->peer, message, message->nlmsg_len, MSG_DONTWAIT | MSG_NOSIGNAL);
}

/* Answers with an error, or with 0 for done. */
static void acknowledge(const struct link *link, const struct nlmsghdr *request, int error)
{
    struct {
        struct nlmsghdr head;
        struct nlmsgerr error;
    } message = {{.nlmsg_len = sizeof message, .nlmsg_type = NLMSG_ERROR},
                 {.error = -error, .msg = *request}};

    answer(link, &message.head, request);
}

/* Describes the interface of a bus, as one of vcan, which has no bit rate. */
static void describe(const struct link *link, const struct nlmsghdr *request, uint32_t bus)
{
    static const struct {
        struct rtattr head;
        char kind[8];
    } linkinfo = {{.rta_len = RTA_LENGTH(5), .rta_type = IFLA_INFO_KIND}, "vcan"};
    const uint32_t mtu = CAN_MTU, queue = QUEUE_LENGTH;
    const uint8_t state = 6; /* IF_OPER_UP */
    union {
        struct nlmsghdr head;
        char bytes[ANSWER_SIZE];
    } message = {.head = {.nlmsg_len = NLMSG_LENGTH(sizeof(struct ifinfomsg)),
                          .nlmsg_type = RTM_NEWLINK,
                          .nlmsg_flags = request->nlmsg_flags & NLM_F_DUMP ? NLM_F_MULTI : 0}};
    struct ifinfomsg *about = NLMSG_DATA(&message.head);

    *about = (struct ifinfomsg){.ifi_type = ARPHRD_CAN_,
                                .ifi_index = FIRST_INDEX + (int)bus,
                                .ifi_flags = IFF_UP | IFF_RUNNING | IFF_NOARP | IFF_LOWER_UP};
    add(&message.head, IFLA_IFNAME, exchange->names[bus], strlen(exchange->names[bus]) + 1);
    add(&message.head, IFLA_MTU, &mtu, sizeof mtu);
    add(&message.head, IFLA_TXQLEN, &queue, sizeof queue);
    add(&message.head, IFLA_OPERSTATE, &state, sizeof state);
    add(&message.head, IFLA_LINKINFO, &linkinfo, sizeof linkinfo);
    answer(link, &message.head, request);
}

/* The bus that a request names by index or name; -1 for none. */
static int bus_of_request(const struct nlmsghdr *request)
{
    const struct ifinfomsg *about = NLMSG_DATA(request);
    const struct rtattr *attribute = IFLA_RTA(about);
    int left = (int)IFLA_PAYLOAD(request);

    if (about->ifi_index > 0)
        return bus_of_index(about->ifi_index);
    for (; RTA_OK(attribute, left); attribute = RTA_NEXT(attribute, left))
        if (attribute->rta_type == IFLA_IFNAME || attribute->rta_type == IFLA_ALT_IFNAME)
            return bus_of_name(RTA_DATA(attribute));
    return -1;
}

static void take(const struct link *link, const struct nlmsghdr *request)
{
    const bool is_about_link = request->nlmsg_type == RTM_GETLINK ||
                               request->nlmsg_type == RTM_NEWLINK ||
                               request->nlmsg_type == RTM_SETLINK;
    int bus;

    if (!is_about_link || request->nlmsg_len < NLMSG_LENGTH(sizeof(struct ifinfomsg))) {
        acknowledge(link, request, EOPNOTSUPP);
        return;
    }
    if (request->nlmsg_type == RTM_GETLINK && (request->nlmsg_flags & NLM_F_DUMP)) {
        struct {
            struct nlmsghdr head;
            int code;
        } done = {{.nlmsg_len = sizeof done, .nlmsg_type = NLMSG_DONE,
                   .nlmsg_flags = NLM_F_MULTI}, 0};

        for (uint32_t each = 0; each < exchange->buses; each++)
            describe(link, request, each);
        answer(link, &done.head, request);
        return;
    }
    bus = bus_of_request(request);
    if (bus < 0)
        acknowledge(link, request, ENODEV);
    else if (request->nlmsg_type == RTM_GETLINK)
        describe(link, request, (uint32_t)bus);
    else if (request->nlmsg_flags & NLM_F_ACK)
        acknowledge(link, request, 0); /* the bench's interfaces are up, whatever is asked */
}

ssize_t ask_link(int fd, const struct msghdr *message)
{
    union {
        struct nlmsghdr head;
        char bytes[REQUEST_SIZE];
    } request;
    size_t size = 0;

    for (size_t i = 0; i < message->msg_iovlen; i++) {
        const struct iovec *part = &message->msg_iov[i];

        if (part->iov_len > sizeof request - size) {
            errno = EMSGSIZE;
            return -1;
        }
        memcpy(request.bytes + size, part->iov_base, part->iov_len);
        size += part->iov_len;
    }
    if (!NLMSG_OK(&request.head, size)) {
        errno = EINVAL;
        return -1;
    }
    take(link_at(fd), &request.head);
    return (ssize_t)size;
}
