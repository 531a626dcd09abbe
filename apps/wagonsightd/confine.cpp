#include "confine.h"

#include <fmt/format.h>
#include <grp.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstddef>
#include <cstring>

#include "web_side.h"

namespace wagonsight {
namespace {

constexpr uid_t kNobody = 65534;  // a number: looking names up needs what is static not to have
constexpr int kNice = 10;
constexpr rlim_t kDescriptors = 128;            // connections_max and a few
constexpr rlim_t kAddressSpace = 256UL << 20U;  // measured: 20 MB

// Sanitizers reserve terabytes of address space and open files to report what they found.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr bool kSanitized = true;
#else
constexpr bool kSanitized = false;
#endif

#if defined(__x86_64__)
constexpr std::uint32_t kArchitecture = AUDIT_ARCH_X86_64;
#elif defined(__aarch64__)
constexpr std::uint32_t kArchitecture = AUDIT_ARCH_AARCH64;
#endif

constexpr std::array kForbidden = {
#ifdef SYS_open
    SYS_open,
    SYS_creat,
    SYS_fork,
    SYS_vfork,
    SYS_unlink,
    SYS_rename,
    SYS_mkdir,
    SYS_symlink,
    SYS_link,
    SYS_chmod,
    SYS_chown,
    SYS_mknod,
#endif
    SYS_openat,
    SYS_openat2,
    SYS_open_by_handle_at,
    SYS_execve,
    SYS_execveat,
    SYS_clone,
    SYS_clone3,
    SYS_socket,
    SYS_socketpair,
    SYS_connect,
    SYS_bind,
    SYS_ptrace,
    SYS_process_vm_readv,
    SYS_process_vm_writev,
    SYS_pidfd_getfd,
    SYS_kill,
    SYS_tkill,
    SYS_unlinkat,
    SYS_renameat2,
    SYS_mkdirat,
    SYS_symlinkat,
    SYS_linkat,
    SYS_fchmodat,
    SYS_fchownat,
    SYS_mknodat,
    SYS_mount,
    SYS_umount2,
    SYS_chroot,
    SYS_pivot_root,
    SYS_unshare,
    SYS_setns,
    SYS_bpf,
    SYS_perf_event_open,
    SYS_userfaultfd,
    SYS_keyctl,
    SYS_add_key,
    SYS_request_key,
    SYS_io_uring_setup,
    SYS_init_module,
    SYS_finit_module,
    SYS_kexec_load,
    SYS_reboot,
    SYS_swapon,
    SYS_sethostname,
    SYS_settimeofday,
    SYS_clock_settime};

Result<void> failed(const char* step) {
  return fail(fmt::format("confining: {}: {}", step, std::strerror(errno)));
}

bool limit(__rlimit_resource resource, rlim_t value) {
  const rlimit both{value, value};
  return setrlimit(resource, &both) == 0;
}

// Each forbidden call answers EPERM, so that a mistake of ours is an error and not a crash.
Result<void> forbid_system_calls() {
  constexpr std::size_t kHead = 4;
  std::array<sock_filter, kHead + 2 * kForbidden.size() + 1> program{};
  const auto load = [](std::size_t offset) {
    return sock_filter BPF_STMT(BPF_LD | BPF_W | BPF_ABS, static_cast<std::uint32_t>(offset));
  };
  program[0] = load(offsetof(seccomp_data, arch));
  program[1] = BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, kArchitecture, 1, 0);
  program[2] = BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_KILL_PROCESS);
  program[3] = load(offsetof(seccomp_data, nr));
  std::size_t at = kHead;
  for (const auto call : kForbidden) {
    program[at++] = BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, static_cast<std::uint32_t>(call), 0, 1);
    program[at++] = BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EPERM);
  }
  program[at] = BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW);
  const sock_fprog filter{static_cast<unsigned short>(program.size()), program.data()};
  if (prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &filter) != 0) return failed("seccomp");
  return {};
}

Result<void> become_nobody() {
  if (geteuid() != 0) return {};
  if (setgroups(0, nullptr) != 0) return failed("setgroups");
  if (setresgid(kNobody, kNobody, kNobody) != 0) return failed("setresgid");
  if (setresuid(kNobody, kNobody, kNobody) != 0) return failed("setresuid");
  return {};
}

}  // namespace

Result<void> confine_web_side(int daemon_pid) {
  if (close_range(kWebUpdaterFd + 1, ~0U, 0) != 0) return failed("close_range");
  errno = 0;
  if (nice(kNice) == -1 && errno != 0) return failed("nice");
  if (auto nobody = become_nobody(); !nobody) return nobody;
  // After the change of user, which clears it.
  if (prctl(PR_SET_PDEATHSIG, SIGKILL) != 0) return failed("PR_SET_PDEATHSIG");
  if (getppid() != daemon_pid) return fail("confining: the daemon is gone already");
  if (prctl(PR_SET_DUMPABLE, 0) != 0) return failed("PR_SET_DUMPABLE");
  if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) return failed("PR_SET_NO_NEW_PRIVS");
  if (!limit(RLIMIT_CORE, 0) || !limit(RLIMIT_NOFILE, kDescriptors)) return failed("setrlimit");
  if (kSanitized) return {};
  if (!limit(RLIMIT_AS, kAddressSpace)) return failed("setrlimit");
  return forbid_system_calls();
}

}  // namespace wagonsight
