/* Stands for a host whose extended registers take 8 KiB more than those of this one, as with AMX.
 *
 * To be preloaded after the library under test. It takes PTRACE_SETREGSET of NT_X86_XSTATE in full
 * size only, as kernels do (xstateregs_set in arch/x86/kernel/fpu/regset.c), and wants the registers
 * that this host lacks back as it gave them: those are INVENTED in every byte.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <elf.h>
#include <errno.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/types.h>
#include <sys/uio.h>

enum { MORE = 8192, INVENTED = 0x5A };

typedef long ptrace_function(enum __ptrace_request, ...);

static ptrace_function *real_ptrace;
static char registers[64 * 1024];

__attribute__((constructor)) static void find_real_ptrace(void)
{
    void *symbol = dlsym(RTLD_NEXT, "ptrace");
    memcpy(&real_ptrace, &symbol, sizeof symbol);
}

static size_t smaller(size_t one, size_t other)
{
    return one < other ? one : other;
}

static long get(pid_t pid, void *type, struct iovec *wanted)
{
    struct iovec here = {registers, sizeof registers - MORE};
    long result = real_ptrace(PTRACE_GETREGSET, pid, type, &here);
    if (result < 0)
        return result;
    memset(registers + here.iov_len, INVENTED, MORE);
    wanted->iov_len = smaller(wanted->iov_len, here.iov_len + MORE);
    memcpy(wanted->iov_base, registers, wanted->iov_len);
    return result;
}

static long set(pid_t pid, void *type, struct iovec *given)
{
    struct iovec here = {registers, sizeof registers - MORE};
    long result = real_ptrace(PTRACE_GETREGSET, pid, type, &here);
    if (result < 0)
        return result;
    given->iov_len = smaller(given->iov_len, here.iov_len + MORE);
    if (given->iov_len < here.iov_len + MORE) {
        errno = EFAULT;
        return -1;
    }
    const char *beyond = (const char *)given->iov_base + here.iov_len;
    for (int i = 0; i < MORE; ++i)
        if (beyond[i] != INVENTED) {
            fprintf(stderr, "larger_host: register byte %d was changed\n", i);
            abort();
        }
    here.iov_base = given->iov_base;
    return real_ptrace(PTRACE_SETREGSET, pid, type, &here);
}

long ptrace(enum __ptrace_request request, ...)
{
    va_list arguments;
    va_start(arguments, request);
    pid_t pid = va_arg(arguments, pid_t);
    void *address = va_arg(arguments, void *);
    void *data = va_arg(arguments, void *);
    va_end(arguments);
    if ((uintptr_t)address == NT_X86_XSTATE) {
        if (request == PTRACE_GETREGSET)
            return get(pid, address, data);
        if (request == PTRACE_SETREGSET)
            return set(pid, address, data);
    }
    return real_ptrace(request, pid, address, data);
}
