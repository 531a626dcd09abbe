// Holds the tables of bad inputs in tests/README.md against what the real programs say. With
// WAGONSIGHT_UPDATE_TABLES=1 the last column is written anew instead.
#include <gmock/gmock.h>

#include <functional>
#include <sstream>
#include <vector>

#include "bad_files.h"
#include "program.h"
#include "running_daemon.h"

namespace wagonsight {
namespace {

using testing::read_text;
using testing::write_text;

const testing::fs::path kTables = WAGONSIGHT_SOURCE_DIR "/tests/README.md";
constexpr std::string_view kRowBegin = "| ", kCellEnd = " | ", kRowEnd = " |";

struct Row {
  std::string what, input, answer;
};

std::string unquoted(std::string cell) {
  if (cell.size() > 1 && cell.front() == '`') cell = cell.substr(1, cell.size() - 2);
  return cell;
}

// One line of a table as cells.
Row row_of(const std::string& line) {
  const std::size_t first = line.find(kCellEnd, kRowBegin.size());
  const std::size_t second = line.find(kCellEnd, first + kCellEnd.size());
  Row row;
  row.what = line.substr(kRowBegin.size(), first - kRowBegin.size());
  row.input = unquoted(line.substr(first + kCellEnd.size(), second - first - kCellEnd.size()));
  row.answer = line.substr(second + kCellEnd.size());
  const bool is_told = row.answer.ends_with(kRowEnd);  // not when it still is to be written
  row.answer.resize(is_told ? row.answer.size() - kRowEnd.size() : 0);
  return row;
}

// What a program said as the text of one cell.
std::string as_cell(std::string_view text) {
  std::string cell;
  for (const char c : text) {
    if (c == '\n')
      cell += "<br>";
    else if (c == '|')
      cell += "\\|";
    else if (c == '<')
      cell += "&lt;";
    else
      cell += c;
  }
  if (cell.ends_with("<br>")) cell.resize(cell.size() - 4);
  return cell;
}

class BadInputs : public testing::ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    write_text(at("scene.toml"), testing::kSmallScene);
    write_text(at("live.toml"), "[demo]\nscene = \"scene.toml\"\n");
    must_run(
        "simulate --scene scene.toml --seconds 0.3 --out sim.mcap --rig-out rig.blob "
        "--images images");
    testing::write_bad_files(folder_);
    must_run("import --depth images/k0 --camera camera.toml --out poseless.mcap");
    std::string other(testing::kSmallScene);
    other.replace(other.find("k0"), 2, "k5");
    write_text(at("other_scene.toml"), other);
    must_run("simulate --scene other_scene.toml --seconds 0.1 --out other.mcap");
    must_run("import --depth dark --camera camera.toml --out dark.mcap");
  }

  // Goes through the table under `title`; `answer_to` turns an input into what is said to it.
  void check_table(const std::string& title,
                   const std::function<std::string(const std::string&)>& answer_to) const {
    const bool updates = std::getenv("WAGONSIGHT_UPDATE_TABLES") != nullptr;
    std::istringstream readme(read_text(kTables));
    std::string text;
    bool is_here = false;
    std::size_t rows = 0;
    for (std::string line; std::getline(readme, line); text += line + '\n') {
      if (line.starts_with("#")) is_here = line == "### " + title;
      if (!is_here || !line.starts_with(kRowBegin) || line.starts_with("| what is")) continue;
      ++rows;
      const Row row = row_of(line);
      const std::string answer = as_cell(answer_to(row.input));
      if (updates)
        line = "| " + row.what + " | `" + row.input + "` | " + answer + " |";
      else
        EXPECT_EQ(answer, row.answer) << row.what << "\n" << row.input;
    }
    EXPECT_GT(rows, 5U) << "the table \"" << title << "\" is not in " << kTables;
    if (updates) write_text(kTables, text);
  }
};

TEST_F(BadInputs, AreToldByTheProgramsAsTheTableSays) {
  check_table("Files and settings", [&](const std::string& command) {
    const std::string program = command.substr(0, command.find(' '));
    const std::string arguments = command.substr(program.size());
    const auto outcome =
        program == "wagonsightd" ? run_program(WAGONSIGHTD_PROGRAM, arguments) : run(arguments);
    EXPECT_EQ(outcome.exit_code, outcome.err.find("--help") == std::string::npos ? 1 : 2)
        << command;
    EXPECT_EQ(outcome.out, "") << command;
    return outcome.err;
  });
}

// A request as the table writes it: METHOD PATH, then headers after commas.
std::string bytes_of(const std::string& input) {
  if (input == "hello") return "hello\r\n\r\n";
  if (input == "GET /livez, 20000 bytes of header")
    return "GET /livez HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Long: " + std::string(20'000, 'x') +
           "\r\n\r\n";
  const std::size_t comma = input.find(", ");
  std::string request = input.substr(0, comma) + " HTTP/1.1\r\nConnection: close\r\n";
  const std::string header = comma == std::string::npos ? "" : input.substr(comma + 2);
  if (!header.starts_with("Host:")) request += "Host: 127.0.0.1\r\n";
  if (!header.empty()) request += header + "\r\n";
  return request + "\r\n";
}

TEST_F(BadInputs, AreToldByTheRunningUnitAsTheTableSays) {
  const testing::RunningDaemon daemon(at("live.toml").string());
  ASSERT_NE(daemon.port(), 0);
  check_table("Requests", [&](const std::string& input) {
    const std::string answer = daemon.ask(bytes_of(input));
    const std::size_t space = answer.find(' ');
    const std::size_t body = answer.find("\r\n\r\n");
    if (body == std::string::npos) return std::string("(no answer)");
    return answer.substr(space + 1, 3) + " " + answer.substr(body + 4);
  });
}

// diagnose talks to the same unit, and reads the bundle that it gives.
TEST_F(BadInputs, OfARunningUnitAreNone) {
  const testing::RunningDaemon daemon(at("live.toml").string());
  ASSERT_NE(daemon.port(), 0);
  const auto asked = must_run(fmt::format("diagnose --port {}", daemon.port()));
  EXPECT_THAT(asked.out, ::testing::ContainsRegex("^(healthy|degraded|starting|ok)"));
  const std::string answer = daemon.get("/api/v1/diagnostics.zip");
  ASSERT_TRUE(answer.starts_with("HTTP/1.1 200")) << answer.substr(0, 300);
  write_text(at("bundle.zip"), answer.substr(answer.find("\r\n\r\n") + 4));
  const auto read = must_run("diagnose bundle.zip");
  EXPECT_THAT(read.out, ::testing::ContainsRegex("^(healthy|degraded|starting|ok)"));
  EXPECT_EQ(must_run("diagnose --json bundle.zip").out.substr(0, 1), "{");
}

}  // namespace
}  // namespace wagonsight
