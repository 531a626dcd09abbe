// open-root DEVICE DATA_BLOCKS ROOT_HASH SALT: makes /dev/mapper/root of a partition that holds a
// file system of so many 4096-byte blocks and, behind it, its hash tree. Every block that is read
// is held against the tree, and the tree against ROOT_HASH; what was changed or has decayed cannot
// be read. All of it is read once here, so that a damaged slot is given up before it is used; what
// decays later restarts the unit. In the initramfs only, once.
#include <fcntl.h>
#include <linux/dm-ioctl.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

namespace {

constexpr std::uint64_t kSectorsPerBlock = 8;

struct Request {
  alignas(8) std::array<char, 4096> bytes{};
  dm_ioctl& head() { return *reinterpret_cast<dm_ioctl*>(bytes.data()); }
};

Request request_for(const char* name) {
  Request request;
  dm_ioctl& head = request.head();
  head.version[0] = DM_VERSION_MAJOR;
  head.data_size = static_cast<std::uint32_t>(request.bytes.size());
  head.data_start = sizeof(dm_ioctl);
  std::snprintf(head.name, sizeof head.name, "%s", name);
  return request;
}

[[noreturn]] void fail(const char* step) {
  std::fprintf(stderr, "open-root: %s: %s\n", step, std::strerror(errno));
  std::exit(1);
}

void send(int control, unsigned long what, Request& request, const char* step) {
  if (ioctl(control, what, request.bytes.data()) != 0) fail(step);
}

// Makes the device behave as `table` says from here on.
dm_ioctl use_table(int control, std::uint64_t sectors, const std::string& table) {
  Request load = request_for("root");
  load.head().flags = DM_READONLY_FLAG;
  load.head().target_count = 1;
  auto* target = reinterpret_cast<dm_target_spec*>(load.bytes.data() + sizeof(dm_ioctl));
  target->length = sectors;
  std::snprintf(target->target_type, sizeof target->target_type, "verity");
  char* text = load.bytes.data() + sizeof(dm_ioctl) + sizeof(dm_target_spec);
  const std::size_t room = load.bytes.size() - sizeof(dm_ioctl) - sizeof(dm_target_spec);
  if (table.size() + 1 > room) std::exit(2);
  std::memcpy(text, table.c_str(), table.size() + 1);
  target->next = static_cast<std::uint32_t>(sizeof(dm_target_spec) + table.size() + 1);
  send(control, DM_TABLE_LOAD, load, "the table");
  Request resume = request_for("root");
  send(control, DM_DEV_SUSPEND, resume, "resuming");
  return resume.head();
}

void read_all(const char* device) {
  const int fd = open(device, O_RDONLY | O_CLOEXEC);
  if (fd < 0) fail(device);
  static std::array<char, 1U << 20U> buffer;
  ssize_t got = 0;
  while ((got = read(fd, buffer.data(), buffer.size())) > 0) {
  }
  if (got < 0) fail("a block does not match its hash");
  close(fd);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 5) {
    std::fputs("usage: open-root DEVICE DATA_BLOCKS ROOT_HASH SALT\n", stderr);
    return 2;
  }
  const std::string device = argv[1], blocks = argv[2], root_hash = argv[3], salt = argv[4];
  mkdir("/dev/mapper", 0755);
  const int control = open("/dev/mapper/control", O_RDWR | O_CLOEXEC);
  if (control < 0) fail("/dev/mapper/control");

  Request create = request_for("root");
  create.head().flags = DM_READONLY_FLAG;
  send(control, DM_DEV_CREATE, create, "creating");

  const std::uint64_t sectors = std::strtoull(blocks.c_str(), nullptr, 10) * kSectorsPerBlock;
  const std::string table = "1 " + device + " " + device + " 4096 4096 " + blocks + " " + blocks +
                            " sha256 " + root_hash + " " + salt;
  const std::uint64_t number = use_table(control, sectors, table).dev;
  const char* made = "/dev/mapper/root";
  unlink(made);
  if (mknod(made, S_IFBLK | 0600,
            makedev(static_cast<unsigned>((number >> 8U) & 0xFFFU),
                    static_cast<unsigned>(number & 0xFFU))) != 0)
    fail(made);
  read_all(made);
  use_table(control, sectors, table + " 1 restart_on_corruption");
  return 0;
}
