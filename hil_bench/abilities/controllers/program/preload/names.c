/* Network interfaces: one a bus, by the bus's name and as can0, can1 and so on. */
#include "bench.h"

#include <net/if.h>
#include <stdarg.h>
#include <stdio.h>
#include <sys/ioctl.h>
#include <linux/can.h>
#include <linux/sockios.h>

#define ARPHRD_CAN_ 280 /* of linux/if_arp.h, which stands against net/if.h */
#define QUEUE_LENGTH 10

int last_stamp(int fd, struct timespec *stamp); /* of can_socket.c */

int bus_of_name(const char *name)
{
    unsigned int number;
    char rest;

    if (!on_bench())
        return -1;
    for (uint32_t bus = 0; bus < exchange->buses; bus++)
        if (strncmp(name, exchange->names[bus], NAME_SIZE) == 0)
            return (int)bus;
    if (sscanf(name, "can%u%c", &number, &rest) == 1 && number < exchange->buses)
        return (int)number;
    return -1;
}

int bus_of_index(int index)
{
    if (!on_bench() || index < FIRST_INDEX || index >= FIRST_INDEX + (int)exchange->buses)
        return -1;
    return index - FIRST_INDEX;
}

EXPORT unsigned int if_nametoindex(const char *name)
{
    int bus = bus_of_name(name);

    return bus < 0 ? REAL(if_nametoindex)(name) : (unsigned int)(FIRST_INDEX + bus);
}

EXPORT char *if_indextoname(unsigned int index, char name[IF_NAMESIZE])
{
    int bus = bus_of_index((int)index);

    if (bus < 0)
        return REAL(if_indextoname)(index, name);
    return memcpy(name, exchange->names[bus], NAME_SIZE);
}

/* Answers for an interface that is a bus; 1 for any other request. */
static int about_interface(unsigned long request, struct ifreq *about)
{
    int bus = request == SIOCGIFNAME ? bus_of_index(about->ifr_ifindex)
                                     : bus_of_name(about->ifr_name);

    if (bus < 0)
        return 1;
    switch (request) {
    case SIOCGIFNAME:
        memcpy(about->ifr_name, exchange->names[bus], NAME_SIZE);
        return 0;
    case SIOCGIFINDEX:
        about->ifr_ifindex = FIRST_INDEX + bus;
        return 0;
    case SIOCGIFMTU:
        about->ifr_mtu = CAN_MTU;
        return 0;
    case SIOCGIFFLAGS:
        about->ifr_flags = IFF_UP | IFF_RUNNING | IFF_NOARP;
        return 0;
    case SIOCGIFTXQLEN:
        about->ifr_qlen = QUEUE_LENGTH;
        return 0;
    default: /* SIOCGIFHWADDR */
        about->ifr_hwaddr.sa_family = ARPHRD_CAN_;
        return 0;
    }
}

static int stamp(int fd, unsigned long request, void *result)
{
    struct timespec stamp;

    if (last_stamp(fd, &stamp) < 0)
        return -1;
    if (request == SIOCGSTAMP_OLD)
        stamp.tv_nsec /= 1000; /* struct timeval */
    memcpy(result, &stamp, sizeof stamp);
    return 0;
}

EXPORT int ioctl(int fd, unsigned long request, ...)
{
    va_list arguments;
    void *argument;

    va_start(arguments, request);
    argument = va_arg(arguments, void *);
    va_end(arguments);
    switch (request) {
    case SIOCGIFNAME:
    case SIOCGIFINDEX:
    case SIOCGIFMTU:
    case SIOCGIFFLAGS:
    case SIOCGIFTXQLEN:
    case SIOCGIFHWADDR:
        if (on_bench() && about_interface(request, argument) == 0)
            return 0;
        break;
    case FIONREAD:
        if (is_can(fd)) {
            *(int *)argument = poll(&(struct pollfd){.fd = fd, .events = POLLIN}, 1, 0) > 0
                                   ? (int)CAN_MTU
                                   : 0;
            return 0;
        }
        break;
    case SIOCGSTAMP_OLD:
    case SIOCGSTAMPNS_OLD:
        if (is_can(fd))
            return stamp(fd, request, argument);
        break;
    default:
        break;
    }
    return REAL(ioctl)(fd, request, argument);
}
