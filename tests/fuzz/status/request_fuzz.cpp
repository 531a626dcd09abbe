#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <string_view>

#include "status/site.h"

// Any request, six lines (method, target, host, origin, authorization, cookie), to a unit with
// tokens on an open network: always an answer, and never a person without the token.
namespace {

using namespace wagonsight;  // NOLINT(google-build-using-namespace): one short target

constexpr std::string_view kSecretZone = "Zone-That-Is-Public";
constexpr double kSecretPosition = 1234.5678;

struct Unit {
  std::unique_ptr<Snapshot> snapshot = std::make_unique<Snapshot>();
  std::unique_ptr<UnitInfo> info = std::make_unique<UnitInfo>();
  std::unique_ptr<StatusSite> site;

  Unit() {
    Person person;
    person.id = 7;
    person.position = {kSecretPosition, 1};
    person.height = 1.7;
    snapshot->frame.people.push_back(person);
    snapshot->occupancy.zones.push_back({kSecretZone, 1, 4, 1.0});
    AccessRules rules;
    rules.read_token = "0123456789abcdef-read";
    rules.admin_token = "0123456789abcdef-admin";
    rules.bound_to_loopback = false;
    site = std::make_unique<StatusSite>(rules);
  }
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const Unit unit;
  std::string_view text(reinterpret_cast<const char*>(data), size);
  std::array<std::string_view, 6> lines{};
  for (std::string_view& line : lines) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  HttpRequest request;
  request.method = lines[0];
  request.target = lines[1];
  request.host = lines[2];
  request.origin = lines[3];
  request.authorization = lines[4];
  request.cookie = lines[5];
  request.peer_is_loopback = size % 2 == 0;
  const HttpAnswer answer = unit.site->answer(request, {unit.snapshot.get(), 0.1, unit.info.get()});
  if (answer.status < 200 || answer.status > 599) std::abort();
  // Without TLS a token may not even travel on this network, so nobody has a right to positions.
  const bool tells_a_person = answer.body.find("1234.5678") != std::string::npos;
  if (tells_a_person && !request.peer_is_loopback) std::abort();
  return 0;
}
