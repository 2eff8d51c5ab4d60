/* A program with CAN sockets for tests/unit/controllers/test_program.py: can_program WHAT.
 *
 * It prints what it sees, a line each, with times in microseconds since its start.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <linux/sockios.h>
#include <net/if.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/ioctl.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/timerfd.h>
#include <sys/times.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

static struct timespec start;

static long now_us(void)
{
    struct timespec now;

    clock_gettime(CLOCK_MONOTONIC, &now);
    return (now.tv_sec - start.tv_sec) * 1000000 + (now.tv_nsec - start.tv_nsec) / 1000;
}

static void say(const char *what, long value)
{
    printf("%ld %s %ld\n", now_us(), what, value);
}

/* Says how a call ended: its result, or the name of its error. */
static void say_end(const char *what, long result)
{
    if (result < 0)
        printf("%ld %s %s\n", now_us(), what, strerrorname_np(errno));
    else
        say(what, result);
}

static int open_can(const char *name)
{
    struct sockaddr_can address = {.can_family = AF_CAN};
    int fd = socket(PF_CAN, SOCK_RAW, CAN_RAW);

    address.can_ifindex = name == NULL ? 0 : (int)if_nametoindex(name);
    if (fd < 0 || bind(fd, (struct sockaddr *)&address, sizeof address) < 0) {
        perror("can_program");
        exit(3);
    }
    return fd;
}

static struct can_frame frame_of(canid_t id, unsigned char byte)
{
    return (struct can_frame){.can_id = id, .can_dlc = 1, .data = {byte}};
}

static void send_frame(int fd, canid_t id, unsigned char byte)
{
    struct can_frame frame = frame_of(id, byte);

    if (write(fd, &frame, sizeof frame) != sizeof frame)
        perror("write");
}

static void cycle(void)
{
    int fd = open_can("can0");
    struct timespec next;

    clock_gettime(CLOCK_MONOTONIC, &next);
    for (unsigned char i = 0; i < 4; i++) {
        next.tv_nsec += 1500000;
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, NULL);
        send_frame(fd, 0x100, i);
    }
}

static void echo(void)
{
    struct can_frame frame;
    int fd = open_can("can0");

    while (read(fd, &frame, sizeof frame) == sizeof frame) {
        say("read", frame.can_id & CAN_EFF_MASK);
        frame.can_id++;
        if (write(fd, &frame, sizeof frame) < 0)
            return;
    }
}

static void waits(void)
{
    int fd = open_can("can0"), set = epoll_create1(0);
    struct pollfd source = {.fd = fd, .events = POLLIN};
    struct timeval rest = {.tv_usec = 2000}, limit = {.tv_usec = 1000};
    struct timespec brief = {.tv_nsec = 250000};
    struct epoll_event event = {.events = EPOLLIN};
    char byte;
    fd_set fds;

    epoll_ctl(set, EPOLL_CTL_ADD, fd, &event);
    FD_ZERO(&fds);
    FD_SET(fd, &fds);
    say("poll", poll(&source, 1, 5));
    say("ppoll", ppoll(&source, 1, &brief, NULL));
    say("select", select(fd + 1, &fds, NULL, NULL, &rest));
    say("rest", rest.tv_usec);
    say("epoll", epoll_wait(set, &event, 1, 3));
    say("usleep", usleep(100));
    say("nanosleep", nanosleep(&brief, NULL));
    setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
    say_end("read", read(fd, &byte, 1));
    say_end("recv", recv(fd, &byte, 1, MSG_DONTWAIT));
    fcntl(fd, F_SETFL, O_NONBLOCK);
    say_end("read", read(fd, &byte, 1));
    say("sleep", sleep(1));
}

static void ready(void) /* a frame comes after 2 ms */
{
    int fd = open_can("can0"), set = epoll_create1(0);
    struct epoll_event event = {.events = EPOLLIN};
    struct pollfd source = {.fd = fd, .events = POLLIN};
    struct timeval limit = {.tv_sec = 1};
    fd_set fds;

    epoll_ctl(set, EPOLL_CTL_ADD, fd, &event);
    FD_ZERO(&fds);
    FD_SET(fd, &fds);
    say("poll", poll(&source, 1, 100));
    say("select", select(fd + 1, &fds, NULL, NULL, &limit));
    say("epoll", epoll_wait(set, &event, 1, 100));
}

static void timers(void)
{
    struct itimerspec every = {.it_value = {0, 1000000}, .it_interval = {0, 500000}};
    int fd = timerfd_create(CLOCK_MONOTONIC, 0);
    uint64_t times;

    timerfd_settime(fd, 0, &every, NULL);
    for (int i = 0; i < 3; i++) {
        if (read(fd, &times, sizeof times) == sizeof times)
            say("times", (long)times);
        usleep(i * 600);
    }
}

static volatile sig_atomic_t signals;

static void count(int number)
{
    (void)number;
    signals++;
}

static void alarms(void)
{
    struct itimerval every = {.it_value = {0, 4000}, .it_interval = {0, 1000}};
    struct sigaction action = {.sa_handler = count};
    struct itimerspec once = {.it_value = {0, 2000000}};
    struct sigevent event = {.sigev_notify = SIGEV_SIGNAL, .sigev_signo = SIGUSR1};
    timer_t timer;

    sigaction(SIGALRM, &action, NULL);
    sigaction(SIGUSR1, &action, NULL);
    timer_create(CLOCK_REALTIME, &event, &timer);
    timer_settime(timer, 0, &once, NULL);
    setitimer(ITIMER_REAL, &every, NULL);
    for (int i = 0; i < 4; i++) {
        say_end("pause", pause());
        say("signals", signals);
    }
}

static void wait_signals(void)
{
    struct sigaction action = {.sa_handler = count};
    struct itimerval once = {.it_value = {0, 2000}};
    struct timespec limit = {.tv_nsec = 3000000};
    struct tms used;
    sigset_t usual, alarms;
    clock_t begin;

    sigemptyset(&alarms);
    sigaddset(&alarms, SIGALRM);
    sigprocmask(SIG_BLOCK, &alarms, &usual);
    sigaction(SIGALRM, &action, NULL);
    say_end("sigtimedwait", sigtimedwait(&alarms, NULL, &limit));
    setitimer(ITIMER_REAL, &once, NULL);
    say_end("sigsuspend", sigsuspend(&usual));
    say("signals", signals);
    begin = times(&used);
    usleep(2000);
    say("ticks", times(&used) - begin);
}

static void batches(void)
{
    struct can_frame frames[4];
    struct iovec parts[4];
    struct mmsghdr messages[4] = {0};
    int fd = open_can("can0"), waiting = -1;

    for (int i = 0; i < 4; i++) {
        parts[i] = (struct iovec){&frames[i], sizeof frames[i]};
        messages[i].msg_hdr = (struct msghdr){.msg_iov = &parts[i], .msg_iovlen = 1};
    }
    ioctl(fd, FIONREAD, &waiting);
    say("waiting", waiting);
    say_end("received", recvmmsg(fd, messages, 4, MSG_WAITFORONE, NULL));
    printf("ids %x %x %x\n", frames[0].can_id, frames[1].can_id, frames[2].can_id);
    ioctl(fd, FIONREAD, &waiting);
    say("waiting", waiting);
    frames[2].can_dlc = 9;
    say_end("sent", sendmmsg(fd, messages, 3, 0));
    say_end("sent", sendmmsg(fd, messages + 2, 1, 0));
}

static void say_ids(const char *what, int fd)
{
    struct can_frame frame;

    printf("%s:", what);
    while (recv(fd, &frame, sizeof frame, MSG_DONTWAIT) > 0)
        printf(" %x", frame.can_id);
    printf("\n");
}

static int open_filtered(const struct can_filter *filters, unsigned int count, int joined)
{
    int fd = open_can("can0");

    setsockopt(fd, SOL_CAN_RAW, CAN_RAW_FILTER, filters, count * sizeof *filters);
    setsockopt(fd, SOL_CAN_RAW, CAN_RAW_JOIN_FILTERS, &joined, sizeof joined);
    return fd;
}

static void filters(void)
{
    const struct can_filter one[] = {{0x123, CAN_SFF_MASK}};
    const struct can_filter two[] = {{0x123, 0x7FF}, {0x200, 0x700}};
    const struct can_filter not[] = {{0x123 | CAN_INV_FILTER, 0x7FF}};
    const struct can_filter both[] = {{0x200, 0x700}, {0x2A0 | CAN_INV_FILTER, 0x7FF}};
    const struct can_filter standard[] = {{0x123, CAN_EFF_FLAG | CAN_RTR_FLAG | CAN_SFF_MASK}};
    const struct can_filter extended[] = {{CAN_EFF_FLAG | 0x123, CAN_EFF_FLAG | CAN_EFF_MASK}};
    int fds[] = {open_filtered(one, 1, 0),      open_filtered(two, 2, 0),
                 open_filtered(not, 1, 0),      open_filtered(both, 2, 1),
                 open_filtered(standard, 1, 0), open_filtered(extended, 1, 0),
                 open_filtered(NULL, 0, 0)};
    const char *names[] = {"one", "two", "not", "both", "standard", "extended", "none"};

    usleep(5000);
    for (int i = 0; i < 7; i++)
        say_ids(names[i], fds[i]);
}

static void say_message(const char *what, int fd)
{
    struct can_frame frame;
    struct sockaddr_can from;
    char control[256], name[IF_NAMESIZE] = "";
    struct iovec part = {&frame, sizeof frame};
    struct msghdr message = {.msg_name = &from, .msg_namelen = sizeof from, .msg_iov = &part,
                             .msg_iovlen = 1, .msg_control = control,
                             .msg_controllen = sizeof control};

    if (recvmsg(fd, &message, MSG_DONTWAIT) < 0) {
        say_end(what, -1);
        return;
    }
    if_indextoname((unsigned int)from.can_ifindex, name);
    printf("%s: %x on %s%s%s", what, frame.can_id, name,
           message.msg_flags & MSG_DONTROUTE ? " local" : "",
           message.msg_flags & MSG_CONFIRM ? " own" : "");
    for (struct cmsghdr *each = CMSG_FIRSTHDR(&message); each; each = CMSG_NXTHDR(&message, each)) {
        struct timeval time;

        if (each->cmsg_level == SOL_SOCKET && each->cmsg_type == SO_TIMESTAMP) {
            memcpy(&time, CMSG_DATA(each), sizeof time);
            printf(" at %ld.%06ld", (long)time.tv_sec, (long)time.tv_usec);
        }
    }
    printf("\n");
}

static void messages(void)
{
    int one = open_can("can0"), other = open_can(NULL), second = open_can("can1"), on = 1, off = 0;
    struct timeval stamp;

    setsockopt(other, SOL_SOCKET, SO_TIMESTAMP, &on, sizeof on);
    usleep(2500); /* two frames come meanwhile, one on each bus */
    say_message("one", one);
    say_message("other", other);
    say_message("other", other);
    say_message("second", second);
    if (ioctl(one, SIOCGSTAMP, &stamp) == 0)
        printf("stamp %ld.%06ld\n", (long)stamp.tv_sec, (long)stamp.tv_usec);
    send_frame(one, 0x10, 0);
    say_message("one", one);
    say_message("other", other);
    say_message("second", second);
    setsockopt(one, SOL_CAN_RAW, CAN_RAW_RECV_OWN_MSGS, &on, sizeof on);
    send_frame(one, 0x11, 0);
    say_message("one", one);
    say_message("other", other);
    setsockopt(one, SOL_CAN_RAW, CAN_RAW_LOOPBACK, &off, sizeof off);
    send_frame(one, 0x12, 0);
    say_message("one", one);
    say_message("other", other);
}

static void names(void)
{
    int fd = open_can("can1"), number = 0;
    struct ifreq request = {.ifr_name = "can1"};
    struct sockaddr_can address = {0};
    socklen_t length = sizeof address, size = sizeof number;

    ioctl(fd, SIOCGIFINDEX, &request);
    say("same index", request.ifr_ifindex == (int)if_nametoindex("can1"));
    ioctl(fd, SIOCGIFMTU, &request);
    say("mtu", request.ifr_mtu);
    ioctl(fd, SIOCGIFFLAGS, &request);
    say("up", (request.ifr_flags & (IFF_UP | IFF_RUNNING)) == (IFF_UP | IFF_RUNNING));
    request.ifr_ifindex = (int)if_nametoindex("front");
    ioctl(fd, SIOCGIFNAME, &request);
    printf("name %s\n", request.ifr_name);
    getsockname(fd, (struct sockaddr *)&address, &length);
    say("bound", address.can_family == AF_CAN &&
                     address.can_ifindex == (int)if_nametoindex("can1"));
    getsockopt(fd, SOL_SOCKET, SO_DOMAIN, &number, &size);
    say("domain", number == AF_CAN);
    strcpy(request.ifr_name, "can7");
    say_end("can7", ioctl(fd, SIOCGIFINDEX, &request));
    say_end("bcm", socket(PF_CAN, SOCK_DGRAM, CAN_BCM));
    address.can_ifindex = 999;
    say_end("bind", bind(fd, (struct sockaddr *)&address, sizeof address));
}

static void wrong(void)
{
    struct canfd_frame longer = {.can_id = 1, .len = 8};
    struct can_frame frame = frame_of(1, 0);
    int fd = open_can("can0"), unbound = socket(PF_CAN, SOCK_RAW, CAN_RAW), on = 1;

    say_end("short", write(fd, &frame, sizeof frame - 1));
    say_end("unbound", write(unbound, &frame, sizeof frame));
    frame.can_dlc = 9;
    say_end("nine bytes", write(fd, &frame, sizeof frame));
    say_end("fd option", setsockopt(fd, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &on, sizeof on));
    say_end("fd frame", write(fd, &longer, sizeof longer));
    say_end("option", setsockopt(fd, SOL_CAN_RAW, 99, &on, sizeof on));
    say_end("connect", connect(fd, NULL, 0));
}

static void copies(void)
{
    int fd = open_can("can0"), copy = dup(fd), other = fcntl(fd, F_DUPFD, 100);

    close(fd);
    send_frame(copy, 1, 0);
    dup2(copy, fd);
    close(copy);
    close(other);
    send_frame(fd, 2, 0);
    close(fd);
    say_end("closed", write(fd, "", 1));
}

static void *answer(void *unused)
{
    echo();
    return unused;
}

static void threads(void)
{
    pthread_t thread;

    pthread_create(&thread, NULL, answer, NULL);
    for (;;) /* the other thread is the one that is looked at */
        pause();
}

static void *idle(void *argument)
{
    return argument;
}

static void thread(void)
{
    pthread_t thread;

    pthread_create(&thread, NULL, idle, NULL);
}

static void children(void) /* one after the other */
{
    for (int i = 0; i < 2; i++) {
        if (fork() == 0) {
            usleep(2000);
            send_frame(open_can("can0"), 0x20, (unsigned char)i);
            exit(0);
        }
        wait(NULL);
    }
    say("time", now_us());
}

static void pipes(void) /* of a child that answers after 3 ms */
{
    int ends[2];
    struct pollfd source;

    if (pipe(ends) < 0)
        return;
    if (fork() == 0) {
        usleep(3000);
        exit(write(ends[1], "", 1) != 1);
    }
    source = (struct pollfd){.fd = ends[0], .events = POLLIN};
    say("poll", poll(&source, 1, 500));
    wait(NULL);
    usleep(1000);
    say("time", now_us());
}

static void together(void)
{
    fork();
    for (;;)
        usleep(100);
}

static void orphan(void)
{
    if (fork() == 0)
        for (;;)
            ;
}

static void terminated(void)
{
    struct sigaction action = {.sa_handler = count};
    int fd = open_can("can0");

    sigaction(SIGTERM, &action, NULL);
    say_end("sleep", usleep(900000));
    say("signals", signals);
    usleep(3000);
    send_frame(fd, 0x30, 0);
    printf("left\n");
}

static void spin(void)
{
    while (now_us() < 3000)
        ;
    send_frame(open_can("can0"), 0x40, 0);
}

static void flood(void)
{
    int fd = open_can("can0");

    for (int i = 0; i < 9000; i++)
        send_frame(fd, 0x50, (unsigned char)i);
}

static void crash(void)
{
    usleep(1500);
    abort();
}

static void forever(void)
{
    for (;;)
        ;
}

static void exits(void)
{
    exit(7);
}

int main(int argc, char **argv)
{
    static const struct {
        const char *name;
        void (*run)(void);
    } parts[] = {
        {"alarms", alarms},     {"batches", batches},   {"signals", wait_signals},
        {"children", children}, {"copies", copies},
        {"crash", crash},       {"cycle", cycle},       {"echo", echo},
        {"exits", exits},       {"filters", filters},   {"flood", flood},
        {"forever", forever},   {"messages", messages}, {"names", names},
        {"orphan", orphan},     {"ready", ready},       {"spin", spin},
        {"terminated", terminated}, {"thread", thread}, {"timers", timers},
        {"pipes", pipes},       {"together", together}, {"threads", threads}, {"waits", waits},       {"wrong", wrong},
    };

    setvbuf(stdout, NULL, _IOLBF, 0);
    clock_gettime(CLOCK_MONOTONIC, &start);
    for (size_t i = 0; argc == 2 && i < sizeof parts / sizeof *parts; i++)
        if (strcmp(argv[1], parts[i].name) == 0) {
            parts[i].run();
            return 0;
        }
    return 2;
}
