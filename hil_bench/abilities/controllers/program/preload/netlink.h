/* Sockets of NETLINK_ROUTE that know the bench's interfaces. */
#ifndef HIL_BENCH_NETLINK_H
#define HIL_BENCH_NETLINK_H

#include "bench.h"

#include <sys/socket.h>

int open_link(int flags);
bool is_link(int fd);
void forget_link(int fd);

/* Gives the address of this end, or of the kernel. */
void name_link(int is_own, void *name, socklen_t *length);

/* Takes a request and answers it. */
ssize_t ask_link(int fd, const struct msghdr *message);

/* A pair of can_socket.c, the second end out of the program's way; -1 with errno. */
int open_pair(int flags, int ends[2]);

#endif
