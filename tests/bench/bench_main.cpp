#include <benchmark/benchmark.h>

#include <algorithm>
#include <array>
#include <string_view>
#include <vector>

#include "bench/benchmarks.h"

// Unless told otherwise: five repetitions, of which mean, median and deviation are told,
// contestants in random order, so that what else the machine does falls on all of them alike.
int main(int argc, char** argv) {
  std::array<char, 28> repetitions{"--benchmark_repetitions=5"};
  std::array<char, 48> aggregates{"--benchmark_report_aggregates_only=true"};
  std::array<char, 52> interleaving{"--benchmark_enable_random_interleaving=true"};
  std::vector<char*> arguments(argv, argv + argc);
  if (std::none_of(arguments.begin(), arguments.end(), [](std::string_view argument) {
        return argument.starts_with("--benchmark_repetitions");
      }))
    arguments.insert(arguments.end(), {repetitions.data(), aggregates.data(), interleaving.data()});
  argc = static_cast<int>(arguments.size());
  arguments.push_back(nullptr);
  argv = arguments.data();
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 2;
  wagonsight::bench::register_chain();
  wagonsight::bench::register_fuse_and_record();
#ifdef WAGONSIGHT_BENCH_PCL
  wagonsight::bench::register_pcl();
#endif
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
  return 0;
}
