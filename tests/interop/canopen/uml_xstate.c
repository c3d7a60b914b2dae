/* Lets User Mode Linux 6.1 run on processors whose register state is larger than it expects (those with AMX).
 *
 * UML keeps 2,696 bytes of each process, as much as AVX-512 needs, and writes them back with PTRACE_SETREGSET. The host
 * accepts the whole state only (EFAULT otherwise). So this library copies the kept part into the current whole state and
 * writes that; the rest, AMX tiles, is not used in the guest. Load it with LD_PRELOAD.
 */
#define _GNU_SOURCE
#include <elf.h>
#include <errno.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

static char whole[65536];

long ptrace(enum __ptrace_request request, ...) {
    va_list given;
    va_start(given, request);
    pid_t pid = va_arg(given, pid_t);
    void *place = va_arg(given, void *);
    void *data = va_arg(given, void *);
    va_end(given);
    if (request == PTRACE_SETREGSET && (long)place == NT_X86_XSTATE) {
        struct iovec all = {whole, sizeof whole}, *part = data;
        if (syscall(SYS_ptrace, PTRACE_GETREGSET, pid, place, &all) < 0)
            return -1;
        if (part->iov_len < all.iov_len) {
            memcpy(whole, part->iov_base, part->iov_len);
            return syscall(SYS_ptrace, request, pid, place, &all);
        }
    }
    if (request == PTRACE_PEEKTEXT || request == PTRACE_PEEKDATA || request == PTRACE_PEEKUSER) {
        long word; /* the system call stores what the library's function returns */
        if (syscall(SYS_ptrace, request, pid, place, &word) < 0)
            return -1;
        errno = 0;
        return word;
    }
    return syscall(SYS_ptrace, request, pid, place, data);
}
