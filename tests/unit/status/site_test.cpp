#include "status/site.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include <nlohmann/json.hpp>

#include "sample_status.h"
#include "status/zip.h"

namespace wagonsight {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using testing::Not;

HttpRequest get(std::string_view target) {
  HttpRequest request;
  request.method = "GET";
  request.target = target;
  request.host = "127.0.0.1:8080";
  request.peer_is_loopback = true;
  return request;
}

std::string header(const HttpAnswer& answer, std::string_view name) {
  for (const auto& [key, value] : answer.headers)
    if (key == name) return value;
  return {};
}

AccessRules with_tokens() {
  AccessRules rules;
  rules.read_token = "read-token-of-the-test";
  rules.admin_token = "admin-token-of-the-test";
  rules.key.fill(7);
  return rules;
}

class Site : public testing::Test {
 protected:
  HttpAnswer ask(const HttpRequest& request, const AccessRules& rules = {}) const {
    return StatusSite(rules).answer(request, sample_.input());
  }
  SampleStatus sample_;
};

TEST_F(Site, AnswersEveryRouteOfItsDescription) {
  const json description = json::parse(ask(get("/api/v1/openapi.json")).body);
  ASSERT_GE(description["paths"].size(), 20U);
  for (const auto& [path, methods] : description["paths"].items()) {
    HttpRequest request = get(path);
    const char* method = methods.contains("get") ? "get" : "post";
    if (!methods.contains("get")) request.method = "POST";
    const HttpAnswer answer = ask(request);
    const bool expected = methods[method]["responses"].contains(std::to_string(answer.status));
    EXPECT_TRUE(expected) << path << " answers " << answer.status;
    if (answer.content_type == "application/json") {
      EXPECT_TRUE(json::accept(answer.body)) << path << ": " << answer.body;
    }
  }
}

TEST_F(Site, TellsErrorsAsOneSentence) {
  for (const auto& [request, status] : {std::pair{get("/nothing"), 404},
                                        {get("/api/v1/update"), 501},
                                        {get("/api/v1/gtfs-rt"), 501}}) {
    const HttpAnswer answer = ask(request);
    EXPECT_EQ(answer.status, status);
    EXPECT_THAT(json::parse(answer.body)["error"].get<std::string>(), testing::EndsWith("."));
  }
  HttpRequest post = get("/api/v1/health");
  post.method = "POST";
  EXPECT_EQ(ask(post).status, 405);
  EXPECT_EQ(header(ask(post), "Allow"), "GET");
}

TEST_F(Site, TellsCountsWithoutPeople) {
  const json occupancy = json::parse(ask(get("/api/v1/occupancy")).body);
  EXPECT_EQ(occupancy["count"], 1);
  EXPECT_EQ(occupancy["quality"], "good");
  EXPECT_EQ(occupancy["zones"][0]["count"], 1);
  EXPECT_THAT(occupancy.dump(), Not(HasSubstr("person")));
  EXPECT_EQ(json::parse(ask(get("/api/v1/people")).body)["people"][0]["id"], 4);
}

TEST_F(Site, IsNotReadyWhileItLearns) {
  EXPECT_EQ(ask(get("/readyz")).status, 200);
  EXPECT_EQ(ask(get("/healthz")).status, 200);
  sample_.snapshot->learning = true;
  EXPECT_EQ(ask(get("/readyz")).status, 503);
  const HttpAnswer verbose = ask(get("/readyz?verbose"));
  EXPECT_EQ(verbose.status, 503);
  EXPECT_THAT(verbose.body, HasSubstr("[-]background learning\n"));
  EXPECT_THAT(verbose.body, HasSubstr("[+]sensor k0 ok, 30.0 of 30 fps\n"));
  EXPECT_EQ(ask(get("/livez")).status, 200);
}

TEST_F(Site, StillAnswersBeforeTheFirstSnapshot) {
  const StatusSite site{AccessRules{}};
  StatusInput input = sample_.input();
  input.snapshot = nullptr;
  EXPECT_EQ(site.answer(get("/livez"), input).status, 503);
  EXPECT_EQ(site.answer(get("/api/v1/people"), input).status, 503);
  EXPECT_EQ(site.answer(get("/"), input).status, 200);
  EXPECT_THAT(site.stream_state(input), HasSubstr("\"verdict\":\"failed\""));
}

TEST_F(Site, RunsNoScriptButItsOwn) {
  const HttpAnswer page = ask(get("/"));
  const std::string policy = header(page, "Content-Security-Policy");
  EXPECT_THAT(policy, HasSubstr("default-src 'none'"));
  EXPECT_THAT(policy, HasSubstr("script-src 'sha256-"));
  EXPECT_THAT(policy, Not(HasSubstr("unsafe")));
  EXPECT_THAT(page.body, Not(HasSubstr("<!--script-->")));
  // Self-contained: nothing is fetched from anywhere else.
  EXPECT_THAT(page.body, Not(HasSubstr("src=\"http")));
  EXPECT_THAT(page.body, Not(HasSubstr("<link rel=\"stylesheet")));
}

TEST_F(Site, SendsThePageCompressedToWhoReadsIt) {
  HttpRequest request = get("/");
  request.accept_encoding = "gzip, br";
  const HttpAnswer packed = ask(request);
  EXPECT_EQ(header(packed, "Content-Encoding"), "gzip");
  z_stream stream{};
  ASSERT_EQ(inflateInit2(&stream, 31), Z_OK);
  std::string page(1 << 20, '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(packed.body.data()));
  stream.avail_in = static_cast<uInt>(packed.body.size());
  stream.next_out = reinterpret_cast<Bytef*>(page.data());
  stream.avail_out = static_cast<uInt>(page.size());
  EXPECT_EQ(inflate(&stream, Z_FINISH), Z_STREAM_END);
  page.resize(stream.total_out);
  inflateEnd(&stream);
  EXPECT_EQ(page, ask(get("/")).body);
}

// ---- who may ask

TEST_F(Site, NeedsATokenForPeopleOnceOneIsSet) {
  for (const char* path :
       {"/api/v1/people", "/api/v1/events", "/api/v1/log", "/api/v1/diagnostics.zip"}) {
    HttpRequest request = get(path);
    EXPECT_EQ(ask(request, with_tokens()).status, 401) << path;
    request.authorization = "Bearer wrong";
    EXPECT_EQ(ask(request, with_tokens()).status, 401) << path;
    request.authorization = "Bearer read-token-of-the-tes";
    EXPECT_EQ(ask(request, with_tokens()).status, 401) << path;
    request.authorization = "Bearer read-token-of-the-test";
    EXPECT_EQ(ask(request, with_tokens()).status, 200) << path;
    request.authorization = "Bearer admin-token-of-the-test";
    EXPECT_EQ(ask(request, with_tokens()).status, 200) << path;
  }
  EXPECT_EQ(ask(get("/api/v1/occupancy"), with_tokens()).status, 200);
  EXPECT_EQ(ask(get("/"), with_tokens()).status, 200);
}

TEST_F(Site, AsksTheUpdaterOnlyForTheAdmin) {
  struct Case {
    const char *method, *path;
    UpdaterWish wish;
  };
  for (const Case& c : {Case{"POST", "/api/v1/update?at=65536&of=900000", UpdaterWish::kBlock},
                        Case{"DELETE", "/api/v1/update", UpdaterWish::kDiscard},
                        Case{"POST", "/api/v1/restart", UpdaterWish::kRestart},
                        Case{"POST", "/api/v1/factory-reset", UpdaterWish::kFactoryReset}}) {
    HttpRequest request = get(c.path);
    request.method = c.method;
    request.authorization = "Bearer read-token-of-the-test";
    const HttpAnswer refused = ask(request, with_tokens());
    EXPECT_EQ(refused.status, 403) << c.path;
    EXPECT_FALSE(refused.updater) << c.path;
    request.authorization = "Bearer admin-token-of-the-test";
    const HttpAnswer answer = ask(request, with_tokens());
    ASSERT_TRUE(answer.updater) << c.path;
    EXPECT_EQ(answer.updater->wish, c.wish);
    EXPECT_EQ(answer.status, 501) << "where there is no updater";
  }
  HttpRequest block = get("/api/v1/update?at=65536&of=900000");
  block.method = "POST";
  EXPECT_FALSE(ask(block).updater) << "without any token nobody may write";
  block.authorization = "Bearer admin-token-of-the-test";
  EXPECT_EQ(ask(block, with_tokens()).updater->offset, 65'536U);
  EXPECT_EQ(ask(block, with_tokens()).updater->total, 900'000U);
  block.target = "/api/v1/update?at=soon";
  EXPECT_EQ(ask(block, with_tokens()).status, 400);
  EXPECT_EQ(ask(get("/api/v1/update")).updater->wish, UpdaterWish::kTell);
}

TEST_F(Site, TurnsATokenIntoACookieThatScriptsCannotRead) {
  HttpRequest login = get("/api/v1/session");
  login.method = "POST";
  EXPECT_EQ(ask(login, with_tokens()).status, 401);
  login.authorization = "Bearer read-token-of-the-test";
  const HttpAnswer answer = ask(login, with_tokens());
  ASSERT_EQ(answer.status, 200);
  const std::string cookie = header(answer, "Set-Cookie");
  EXPECT_THAT(cookie, HasSubstr("HttpOnly"));
  EXPECT_THAT(cookie, HasSubstr("SameSite=Strict"));
  EXPECT_THAT(cookie, Not(HasSubstr("read-token")));

  HttpRequest events = get("/api/v1/events");
  const std::string value = "other=1; " + cookie.substr(0, cookie.find(';'));
  events.cookie = value;
  EXPECT_EQ(ask(events, with_tokens()).status, 200);
  EXPECT_TRUE(ask(events, with_tokens()).stream);
  AccessRules after_restart = with_tokens();
  after_restart.key.fill(8);
  EXPECT_EQ(ask(events, after_restart).status, 401);
}

TEST_F(Site, AcceptsNoEmptyTokenWhereOnlyTheOtherOneIsSet) {
  AccessRules only_admin;
  only_admin.admin_token = "admin-token-of-the-test";
  HttpRequest request = get("/api/v1/people");
  request.authorization = "Bearer ";
  EXPECT_EQ(ask(request, only_admin).status, 401);
}

TEST_F(Site, RefusesWhatAForeignPageCaused) {
  HttpRequest request = get("/api/v1/people");
  request.host = "evil.example:8080";
  EXPECT_EQ(ask(request).status, 421);
  request.host = "";
  EXPECT_EQ(ask(request).status, 421);
  request.host = "127.0.0.1.evil.example";
  EXPECT_EQ(ask(request).status, 421);
  for (const char* own : {"localhost:8080", "LOCALHOST", "[::1]:8080", "10.1.2.3"}) {
    request.host = own;
    EXPECT_EQ(ask(request).status, 200) << own;
  }
  request = get("/api/v1/people");
  for (const char* foreign : {"http://evil.example", "null", "http://127.0.0.1:9090"}) {
    request.origin = foreign;
    EXPECT_EQ(ask(request).status, 403) << foreign;
  }
  request.origin = "http://127.0.0.1:8080";
  EXPECT_EQ(ask(request).status, 200);
  AccessRules named;
  named.host_names.push_back("wagon-7.local");
  request = get("/api/v1/people");
  request.host = "wagon-7.local";
  EXPECT_EQ(ask(request, named).status, 200);
}

TEST_F(Site, KeepsTokensOffOpenNetworks) {
  HttpRequest request = get("/api/v1/people");
  request.peer_is_loopback = false;
  AccessRules open;
  open.bound_to_loopback = false;
  EXPECT_EQ(ask(request, open).status, 403);  // no token is configured
  open = with_tokens();
  open.bound_to_loopback = false;
  request.authorization = "Bearer read-token-of-the-test";
  EXPECT_EQ(ask(request, open).status, 403);
  open.trusted_network = true;
  EXPECT_EQ(ask(request, open).status, 200);
  // Counts may be told to anybody.
  HttpRequest counts = get("/api/v1/occupancy");
  counts.peer_is_loopback = false;
  EXPECT_EQ(ask(counts, open).status, 200);
}

// ---- diagnostics

TEST_F(Site, PacksADiagnosisWithoutPeopleOrSecrets) {
  sample_.unit->settings = "[web.tokens]\nread = \"(removed)\"\n";
  HttpRequest request = get("/api/v1/diagnostics.zip");
  request.authorization = "Bearer read-token-of-the-test";
  const HttpAnswer answer = ask(request, with_tokens());
  EXPECT_EQ(answer.content_type, "application/zip");
  EXPECT_EQ(answer.body.substr(0, 4), "PK\x03\x04");
  EXPECT_THAT(answer.body, HasSubstr("health.json"));
  EXPECT_THAT(answer.body, Not(HasSubstr("people.json")));
}

TEST(Zip, HoldsWhatWasPutIn) {
  const std::string content = "one line\nanother line\nanother line\n";
  const std::string archive = make_zip({{"a/b.txt", content}, {"empty", ""}}, 1.0e9);
  const auto u16 = [&](std::size_t at) {
    return static_cast<unsigned>(static_cast<unsigned char>(archive[at])) |
           static_cast<unsigned>(static_cast<unsigned char>(archive[at + 1])) << 8U;
  };
  const auto u32 = [&](std::size_t at) { return u16(at) | u16(at + 2) << 16U; };
  // From the end: the directory names both entries and where they lie.
  const std::size_t end = archive.size() - 22;
  ASSERT_EQ(archive.substr(end, 4), "PK\x05\x06");
  EXPECT_EQ(u16(end + 10), 2U);
  const std::size_t directory = u32(end + 16);
  ASSERT_EQ(archive.substr(directory, 4), "PK\x01\x02");
  EXPECT_EQ(archive.substr(directory + 46, u16(directory + 28)), "a/b.txt");
  EXPECT_EQ(u32(directory + 24), content.size());
  // 2001-09-09 01:46:40 UTC
  EXPECT_EQ(u16(directory + 14), (2001U - 1980U) << 9U | 9U << 5U | 9U);
  EXPECT_EQ(u16(directory + 12), 1U << 11U | 46U << 5U | 20U);

  const std::size_t local = u32(directory + 42);
  ASSERT_EQ(archive.substr(local, 4), "PK\x03\x04");
  const std::size_t data = local + 30 + u16(local + 26) + u16(local + 28);
  z_stream stream{};
  ASSERT_EQ(inflateInit2(&stream, -15), Z_OK);
  std::string out(content.size(), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(archive.data() + data));
  stream.avail_in = u32(local + 18);
  stream.next_out = reinterpret_cast<Bytef*>(out.data());
  stream.avail_out = static_cast<uInt>(out.size());
  EXPECT_EQ(inflate(&stream, Z_FINISH), Z_STREAM_END);
  inflateEnd(&stream);
  EXPECT_EQ(out, content);
  EXPECT_EQ(u32(local + 14), crc32(0, reinterpret_cast<const Bytef*>(content.data()),
                                   static_cast<uInt>(content.size())));
}

}  // namespace
}  // namespace wagonsight
