#pragma once

#include <CLI/CLI.hpp>
#include <functional>

#include "base/result.h"

// The operator's tool: one file a command. Each add_* declares its options and leaves in `run` what
// is to be done when its command was chosen.
namespace wagonsight {

struct CommandLine {
  CLI::App app;
  std::function<Result<void>()> run;
};

void add_simulate(CommandLine& line);
void add_import(CommandLine& line);
void add_record(CommandLine& line);
void add_replay(CommandLine& line);
void add_evaluate(CommandLine& line);
void add_inspect(CommandLine& line);
void add_export(CommandLine& line);
void add_diagnose(CommandLine& line);
void add_devices(CommandLine& line);
void add_bundle(CommandLine& line);
void add_update(CommandLine& line);

}  // namespace wagonsight
