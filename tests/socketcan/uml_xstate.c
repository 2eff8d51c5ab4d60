/* Lets Debian's User-Mode Linux 6.1 run where the processor has more extended registers than it
 * knows, as with AMX.
 *
 * A kernel accepts PTRACE_SETREGSET of NT_X86_XSTATE in full size only and otherwise fails with
 * EFAULT. The buffer of User-Mode Linux holds 2696 bytes; with AMX the full size is 11008, and it
 * panics: "ptrace set fp regs failed, errno = 14". This library stands before the ptrace() of libc:
 * a set that the kernel refuses as too short is laid over the tracee's present registers, and all
 * of them are written. What lies beyond the caller's buffer keeps its value. Every other request
 * reaches the kernel unchanged, so that the library does nothing where nothing is wrong.
 *
 *   gcc -shared -fPIC -O2 -o uml_xstate.so uml_xstate.c
 *   LD_PRELOAD=$PWD/uml_xstate.so linux.uml ...
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <errno.h>
#include <stdarg.h>
#include <stdint.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>

typedef long ptrace_function(enum __ptrace_request, ...);

static ptrace_function *real_ptrace;

__attribute__((constructor)) static void find_real_ptrace(void)
{
    /* By memcpy, since ISO C converts no object pointer to a function pointer. */
    void *symbol = dlsym(RTLD_NEXT, "ptrace");
    memcpy(&real_ptrace, &symbol, sizeof symbol);
}

/* Writes the tracee's registers, the first of them from `given`. */
static long set_whole(pid_t pid, void *type, const struct iovec *given)
{
    /* On no stack: those of User-Mode Linux are 16 KiB small. One a thread: each traces others. */
    static _Thread_local char registers[64 * 1024] __attribute__((aligned(64)));
    struct iovec whole = {registers, sizeof registers};
    long result = real_ptrace(PTRACE_GETREGSET, pid, type, &whole);
    if (result < 0)
        return result;
    if (given->iov_len >= whole.iov_len) { /* not too short: the kernel had another reason */
        errno = EFAULT;
        return -1;
    }
    memcpy(registers, given->iov_base, given->iov_len);
    return real_ptrace(PTRACE_SETREGSET, pid, type, &whole);
}

long ptrace(enum __ptrace_request request, ...)
{
    va_list arguments;
    va_start(arguments, request);
    pid_t pid = va_arg(arguments, pid_t);
    void *address = va_arg(arguments, void *);
    void *data = va_arg(arguments, void *);
    va_end(arguments);

    if (!real_ptrace)
        find_real_ptrace(); /* called before the constructor, by another library's */
    if (!real_ptrace) {
        errno = ENOSYS;
        return -1;
    }
    int errno_before = errno;
    long result = real_ptrace(request, pid, address, data);
    int is_too_short = result == -1 && errno == EFAULT && request == PTRACE_SETREGSET
        && (uintptr_t)address == NT_X86_XSTATE;
    if (!is_too_short)
        return result;
    errno = errno_before;
    return set_whole(pid, address, data);
}
