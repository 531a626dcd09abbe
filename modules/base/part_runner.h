#pragma once

#include <cstddef>
#include <type_traits>

namespace wagonsight {

// Who does work that falls into independent parts. Modules have no threads: whoever has some hands
// a runner in, and without one a caller does its parts one after the other.
class PartRunner {
 public:
  // Part `part` of a job. Only one part at a time is done as `worker`, so a worker's index chooses
  // memory to work in.
  using Part = void (*)(void* job, std::size_t part, std::size_t worker);

  virtual ~PartRunner() = default;
  // At least 1; always the same.
  virtual std::size_t workers() const = 0;
  // Does parts 0 .. count - 1, each once, and returns when all are done; what they wrote is seen by
  // the caller then. Which worker does which part, and when, is left open. Does not allocate.
  virtual void run(std::size_t count, void* job, Part part) = 0;

 protected:
  PartRunner() = default;
  PartRunner(const PartRunner&) = default;
  PartRunner& operator=(const PartRunner&) = default;
};

// do_part(part, worker) for all parts; `runner` nullptr: one after the other, as worker 0.
template <class DoPart>
void run_parts(PartRunner* runner, std::size_t count, DoPart&& do_part) {
  using Job = std::remove_reference_t<DoPart>;
  if (runner == nullptr) {
    for (std::size_t part = 0; part < count; ++part) do_part(part, std::size_t{0});
    return;
  }
  runner->run(count, &do_part, [](void* job, std::size_t part, std::size_t worker) {
    (*static_cast<Job*>(job))(part, worker);
  });
}

}  // namespace wagonsight
