#include "evaluate/evaluate.h"

#include <fmt/format.h>

#include "commands.h"
#include "files.h"

namespace wagonsight {
namespace {

struct EvaluateCommand {
  std::string truth, people;
  bool json = false;
};

Result<std::vector<Instant>> read_people(const std::string& path) {
  const auto file = open_input(path);
  if (!file) return tl::unexpected(file.error());
  auto instants = parse_people_file(file->text());
  if (!instants) return fail(fmt::format("{}: {}", path, instants.error().message));
  if (instants->empty()) return fail(fmt::format("{} is empty; there is nothing to compare", path));
  return instants;
}

Result<void> run_evaluate(const EvaluateCommand& command) {
  const auto truth = read_people(command.truth);
  if (!truth) return tl::unexpected(truth.error());
  const auto people = read_people(command.people);
  if (!people) return tl::unexpected(people.error());
  const Scores scores = evaluate(*truth, *people);
  fmt::print("{}\n", command.json ? to_json(scores) : to_table(scores));
  return {};
}

}  // namespace

void add_evaluate(CommandLine& line) {
  auto options = std::make_shared<EvaluateCommand>();
  CLI::App* command = line.app.add_subcommand(
      "evaluate", "Score people that were found against the truth: CLEAR MOT, IDF1, HOTA, counts");
  command->add_option("--truth", options->truth, "The truth, one JSON object a line")->required();
  command->add_option("--people", options->people, "What replay found")->required();
  command->add_flag("--json", options->json, "One JSON object instead of a table");
  command->callback([&line, options] { line.run = [options] { return run_evaluate(*options); }; });
}

}  // namespace wagonsight
