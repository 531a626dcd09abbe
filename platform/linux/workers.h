#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "base/part_runner.h"
#include "base/time.h"

namespace wagonsight {

// A small fixed set of threads that share the parts of one job with the thread that has it.
//
//   made --- start() ---> threads wait <--- run() ---> threads take parts
//     ^------ stop() -----------'
//
// Where there are no threads (not started, or a single worker) the caller does all parts. Parts are
// taken one by one in their order, so the longest should come first. The heap of the threads is
// sealed. One thread calls start(), stop() and run().
class Workers final : public PartRunner {
 public:
  // `count` workers, the caller of run() among them; 0 counts as 1. Allocates; makes no thread.
  explicit Workers(std::size_t count);
  ~Workers() override;  // stops
  Workers(const Workers&) = delete;
  Workers& operator=(const Workers&) = delete;

  // Returns when the threads are ready.
  void start();
  void stop();

  std::size_t workers() const override { return helpers_.size() + 1; }
  void run(std::size_t count, void* job, Part part) override;

  // Of the threads, for any thread: how many they are, how often each has turned (many times a
  // second while it is not stuck in a part), and what all of them have used so far.
  std::size_t helper_count() const { return helpers_.size(); }
  std::uint64_t turns(std::size_t helper) const {
    return helpers_[helper]->turns.load(std::memory_order_relaxed);
  }
  Duration helpers_cpu_time() const;
  std::uint64_t helpers_page_faults() const;

 private:
  struct Helper {
    std::thread thread;
    std::atomic<std::uint64_t> turns{0}, page_faults{0};
    std::atomic<Duration::rep> cpu_time{0};
  };

  void help(std::size_t index);
  void tell(Helper& helper);
  void take_parts(std::size_t worker, Helper* helper);

  std::vector<std::unique_ptr<Helper>> helpers_;
  bool is_started_ = false;

  std::mutex mutex_;  // over what follows, up to next_
  std::condition_variable begin_, end_;
  bool stop_ = false;
  bool is_open_ = false;     // there is a job whose parts may be taken
  std::uint64_t jobs_ = 0;   // so far
  std::size_t ready_ = 0;    // threads that wait for their first job
  std::size_t at_work_ = 0;  // threads in the job
  void* job_ = nullptr;      // these three stay as they are while the job is open
  Part part_ = nullptr;
  std::size_t part_count_ = 0;
  std::atomic<std::size_t> next_{0};  // the next part to take
};

// How many workers suit: as many as asked for; 0 leaves it open: two where there is a stereo camera
// and a second processor for it, else one, which four Kinects do not fill.
std::size_t suitable_workers(int wanted, bool has_stereo);

}  // namespace wagonsight
