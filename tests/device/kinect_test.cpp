#include "kinect/kinect_sensor.h"

#include <gmock/gmock.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "kinect_bench.h"

// Real libusb and libfreenect, emulated Kinects. WAGONSIGHT_DEVICE_FRAMESETS says how many frames
// the pixel test is to last (10,000 nightly, 100,000 as a soak).
namespace wagonsight::device {
namespace {

using ::testing::HasSubstr;

class KinectTest : public ::testing::Test {
 protected:
  KinectTest() { set_sealed_heap_rule(SealedHeapRule::kAbort); }

  static void expect_all_is_well(const KinectBench& bench, std::size_t unit) {
    const KinectBench::Balance balance = bench.balance(unit);
    EXPECT_EQ(bench.log(unit).wrong_pixels, 0U) << "unit " << unit;
    EXPECT_EQ(balance.missing, 0U) << "unit " << unit;
    EXPECT_EQ(balance.delivered_damaged, 0U) << "unit " << unit;
    EXPECT_EQ(balance.repeated, 0U) << "unit " << unit;
  }
  static void expect_untouched(const KinectBench& bench, std::size_t unit) {
    expect_all_is_well(bench, unit);
    EXPECT_EQ(bench.log(unit).damaged, 0U) << "unit " << unit;
    EXPECT_EQ(bench.sensor(unit).counters().damaged, 0U) << "unit " << unit;
    EXPECT_EQ(bench.sensor(unit).counters().dropped, 0U) << "unit " << unit;
    EXPECT_EQ(bench.sensor(unit).counters().resets, 0U) << "unit " << unit;
  }
};

std::size_t framesets_wanted() {
  const char* text = std::getenv("WAGONSIGHT_DEVICE_FRAMESETS");
  return text == nullptr ? 300 : static_cast<std::size_t>(std::atol(text));
}

TEST_F(KinectTest, FourRunAtThirtyFramesASecondWithEveryPixelAsItWasSent) {
  KinectBench bench(4);
  const std::size_t wanted = framesets_wanted();
  bench.run(1.0);  // to open
  bench.run(static_cast<double>(wanted) / 30.0);
  for (std::size_t i = 0; i < 4; ++i) {
    expect_untouched(bench, i);
    EXPECT_GE(bench.log(i).good.size(), wanted);
    EXPECT_EQ(bench.thread(i).trouble(), "");
  }
  std::printf("pixels checked: %.0f million\n",
              4 * static_cast<double>(bench.log(0).good.size()) * KinectUnit::kPixels * 1e-6);
}

// One fault of the cable on one unit; its frames are right or counted, the others' untouched.
void with_packet_fault(const char* name, double KinectFaults::*fault, double share) {
  KinectBench bench(3);
  bench.run(1.0);
  bench.faults(1).*fault = share;
  bench.run(8.0);
  bench.faults(1).*fault = 0;
  bench.run(1.0);
  const KinectBench::Balance balance = bench.balance(1);
  const Sensor::Counters counters = bench.sensor(1).counters();
  std::printf("%s: %zu frames good, %llu damaged, %llu whole ones missing\n", name,
              bench.log(1).good.size(), static_cast<unsigned long long>(counters.damaged),
              static_cast<unsigned long long>(balance.missing));
  EXPECT_EQ(bench.log(1).wrong_pixels, 0U);
  EXPECT_EQ(balance.delivered_damaged, 0U);
  EXPECT_EQ(balance.repeated, 0U);
  EXPECT_GT(counters.damaged, 20U);
  // Every frame of the device since the first good one was delivered or counted.
  const auto& good = bench.log(1).good;
  const std::uint64_t passed = good.back().number - good.front().number + 1;
  EXPECT_EQ(passed, good.size() + counters.damaged + counters.dropped);
  EXPECT_EQ(counters.resets, 0U);
}

TEST_F(KinectTest, LostPacketsNeverGiveAWrongFrame) {
  with_packet_fault("lost packets, 1 in 1000", &KinectFaults::lost, 1e-3);
}
TEST_F(KinectTest, ManyLostPacketsNeverGiveAWrongFrame) {
  with_packet_fault("lost packets, 1 in 50", &KinectFaults::lost, 0.02);
}
TEST_F(KinectTest, TruncatedPacketsNeverGiveAWrongFrame) {
  with_packet_fault("truncated packets, 1 in 1000", &KinectFaults::truncated, 1e-3);
}
TEST_F(KinectTest, GarbageNeverGivesAWrongFrame) {
  with_packet_fault("garbage packets, 1 in 1000", &KinectFaults::garbage, 1e-3);
}
TEST_F(KinectTest, WrongChecksumsNeverGiveAWrongFrame) {
  with_packet_fault("wrong checksums, 1 in 1000", &KinectFaults::corrupted, 1e-3);
}

// How a fault that interrupts the stream went, for the table of README.md.
struct Interruption {
  double noticed_s = 0;    // from the fault to the sensor's saying so
  double recovered_s = 0;  // from the fault's end (or begin) to the next good frame
};
Interruption interrupt(KinectBench& bench, const char* name, const std::function<void()>& fault) {
  bench.run(2.0);
  VirtualTime& time = VirtualTime::instance();
  bench.thread(1).forget_trouble();
  const Nanoseconds begin = time.now();
  fault();
  const double recovered = bench.run_until_frame(1, 60);
  Interruption seen;
  seen.noticed_s = static_cast<double>(bench.thread(1).trouble_since() - begin) * 1e-9;
  seen.recovered_s = recovered;
  bench.run(6.0);
  std::printf("%-40s noticed after %.2f s, frames again after %.2f s\n", name, seen.noticed_s,
              seen.recovered_s);
  return seen;
}

TEST_F(KinectTest, StallIsNoticedAndEndedByAReset) {
  KinectBench bench(3);
  const auto seen = interrupt(bench, "stream stalls", [&] { bench.faults(1).silent = true; });
  EXPECT_LT(seen.noticed_s, 1.0);
  EXPECT_GT(seen.recovered_s, 0);
  EXPECT_LT(seen.recovered_s, 5.0);
  EXPECT_EQ(bench.sensor(1).ladder().bus_resets, 1U);
  EXPECT_EQ(bench.sensor(1).ladder().power_cycles, 0U);
  EXPECT_EQ(bench.thread(1).trouble(), "");
  expect_all_is_well(bench, 1);
  expect_untouched(bench, 0);
  expect_untouched(bench, 2);
}

TEST_F(KinectTest, WedgeIsNoticedAndEndedByAReset) {
  KinectBench bench(3);
  const auto seen = interrupt(bench, "wedged", [&] { bench.faults(1).wedged = true; });
  EXPECT_LT(seen.noticed_s, 1.0);
  EXPECT_GT(seen.recovered_s, 0);
  EXPECT_LT(seen.recovered_s, 5.0);
  EXPECT_EQ(bench.sensor(1).ladder().bus_resets, 1U);
  expect_all_is_well(bench, 1);
  expect_untouched(bench, 0);
  expect_untouched(bench, 2);
}

TEST_F(KinectTest, WedgeThatOutlivesAResetIsEndedByItsPortsPower) {
  KinectBench bench(3);
  const auto seen = interrupt(bench, "wedged, a reset does not help", [&] {
    bench.faults(1).wedged = bench.faults(1).wedge_outlives_reset = true;
  });
  EXPECT_LT(seen.noticed_s, 1.0);
  EXPECT_GT(seen.recovered_s, 0);
  EXPECT_LT(seen.recovered_s, 10.0);
  EXPECT_GE(bench.sensor(1).ladder().bus_resets, 1U);
  EXPECT_EQ(bench.sensor(1).ladder().power_cycles, 1U);
  EXPECT_GE(UsbBuses::instance().counters().port_cycles, 1U);
  expect_all_is_well(bench, 1);
  expect_untouched(bench, 0);
  expect_untouched(bench, 2);
}

TEST_F(KinectTest, UnplugIsNoticedAndItsReturnToo) {
  KinectBench bench(3);
  const auto unit = bench.shared_unit(1);
  const auto seen = interrupt(bench, "unplugged for 3 s, returns elsewhere", [&] {
    UsbBuses::instance().unplug(KinectBench::bus_of(1), 1);
    unit->power_cycle();
    bench.script(3.0, [unit] { UsbBuses::instance().plug_locked(unit, 7, 2); });
  });
  EXPECT_LT(seen.noticed_s, 0.1);
  EXPECT_GT(seen.recovered_s, 3.0);
  EXPECT_LT(seen.recovered_s, 4.0);
  EXPECT_EQ(bench.sensor(1).counters().resets, 1U);
  expect_all_is_well(bench, 1);
  expect_untouched(bench, 0);
  expect_untouched(bench, 2);
}

TEST_F(KinectTest, RefusedRequestsAreTriedAgain) {
  KinectBench bench(3);
  const auto seen = interrupt(bench, "unplugged for 1 s, then 3 refused requests", [&] {
    const auto unit = bench.shared_unit(1);
    UsbBuses::instance().unplug(KinectBench::bus_of(1), 1);
    unit->power_cycle();
    unit->faults.stalled_requests = 3;
    bench.script(1.0, [unit] { UsbBuses::instance().plug_locked(unit, 2, 1); });
  });
  EXPECT_GT(seen.recovered_s, 1.0);
  EXPECT_LT(seen.recovered_s, 8.0);
  expect_all_is_well(bench, 1);
  expect_untouched(bench, 0);
}

TEST_F(KinectTest, EndlessEmptyRepliesHoldNobody) {
  KinectBench bench(2, [](std::size_t, KinectUnit::Options&) {});
  bench.faults(1).empty_replies = true;
  bench.run(6.0);
  EXPECT_EQ(bench.log(1).good.size(), 0U);
  EXPECT_THAT(bench.thread(1).trouble(), HasSubstr("does not answer"));
  bench.faults(1).empty_replies = false;
  EXPECT_GT(bench.run_until_frame(1, 30), 0);
  expect_untouched(bench, 0);
}

TEST_F(KinectTest, RepliesToOtherRequestsAreRefused) {
  KinectBench bench(2);
  bench.faults(1).foreign_replies = true;
  bench.run(4.0);
  EXPECT_EQ(bench.log(1).good.size(), 0U);
  EXPECT_THAT(bench.thread(1).trouble(), HasSubstr("answers wrongly"));
  bench.faults(1).foreign_replies = false;
  EXPECT_GT(bench.run_until_frame(1, 30), 0);
  expect_untouched(bench, 0);
}

TEST_F(KinectTest, OpticsThatNoKinectHasAreRefused) {
  KinectBench bench(1, [](std::size_t, KinectUnit::Options& options) {
    options.optics.reference_distance_cm = std::nanf("");
  });
  bench.run(3.0);
  EXPECT_EQ(bench.log(0).good.size(), 0U);
  EXPECT_THAT(bench.thread(0).trouble(), HasSubstr("optics"));
}

TEST_F(KinectTest, DescriptorsWithoutEndpointsDoNotKeepItFromStreaming) {
  KinectBench bench(1, [](std::size_t, KinectUnit::Options&) {});
  bench.faults(0).wrong_configuration = true;
  bench.run(3.0);
  EXPECT_GT(bench.log(0).good.size(), 30U);
  expect_all_is_well(bench, 0);
}

TEST_F(KinectTest, SlowConnectionIsRefusedInWords) {
  KinectBench bench(1, [](std::size_t, KinectUnit::Options& o) { o.speed_mbit = 12; });
  bench.run(2.0);
  EXPECT_EQ(bench.log(0).good.size(), 0U);
  EXPECT_THAT(bench.thread(0).trouble(), HasSubstr("480"));
}

TEST_F(KinectTest, SharedBusIsSaidAndUsed) {
  KinectBench bench(2);
  bench.run(0.2);
  UsbBuses::instance().unplug(KinectBench::bus_of(1), 1);
  UsbBuses::instance().plug(bench.shared_unit(1), KinectBench::bus_of(0), 2);
  bench.run(4.0);
  EXPECT_THAT(bench.thread(1).trouble(), HasSubstr("same USB bus"));
  EXPECT_GT(bench.log(1).good.size(), 60U);
  expect_all_is_well(bench, 1);
}

TEST_F(KinectTest, KernelDriverIsTakenOff) {
  UsbBuses::instance().let_kernel_take_devices(true);
  KinectBench bench(1);
  bench.run(2.0);
  EXPECT_GT(bench.log(0).good.size(), 30U);
}

TEST_F(KinectTest, TooLittleMemoryForTransfersIsSaid) {
  UsbBuses::instance().limit_memory(200'000);
  KinectBench bench(1);
  bench.run(2.0);
  EXPECT_EQ(bench.log(0).good.size(), 0U);
  EXPECT_THAT(bench.thread(0).trouble(), HasSubstr("usbfs_memory_mb"));
  UsbBuses::instance().limit_memory(0);
  EXPECT_GT(bench.run_until_frame(0, 30), 0);
}

TEST_F(KinectTest, AbsentDeviceIsSaidAndFoundWhenItComes) {
  KinectBench bench(1);
  UsbBuses::instance().unplug(KinectBench::bus_of(0), 1);
  bench.run(3.0);
  EXPECT_THAT(bench.thread(0).trouble(), HasSubstr("plugged in"));
  bench.shared_unit(0)->power_cycle();
  UsbBuses::instance().plug(bench.shared_unit(0), 3, 1);
  const double took = bench.run_until_frame(0, 10);
  EXPECT_GT(took, 0);
  EXPECT_LT(took, 1.0);
}

// Light to instant, less the constant that no arrival can tell, over the second half of a run.
std::vector<double> offsets_ms(KinectBench& bench, std::size_t unit, std::size_t from) {
  std::vector<double> offsets;
  const auto& good = bench.log(unit).good;
  for (std::size_t i = from; i < good.size(); ++i) {
    const auto light = bench.unit(unit).light_of(good[i].number);
    const auto instant = good[i].instant.time_since_epoch().count();
    offsets.push_back(static_cast<double>(instant - light) * 1e-6);
  }
  return offsets;
}

TEST_F(KinectTest, InstantsAreKnownToAMillisecondUnderDriftAndJitter) {
  KinectBench bench(4, [](std::size_t unit, KinectUnit::Options& options) {
    const double drifts[] = {-50, 50, 25, -10};
    options.drift_ppm = drifts[unit];
    options.jitter = 5'000'000;
  });
  bench.run(24.0);
  double low = 1e9;
  double high = -1e9;
  for (std::size_t i = 0; i < 4; ++i) {
    for (const double offset : offsets_ms(bench, i, 16 * 30)) {
      low = std::min(low, offset);
      high = std::max(high, offset);
    }
    expect_all_is_well(bench, i);
  }
  std::printf("50 ppm, 5 ms jitter: all instants of four units within %.3f ms of each other\n",
              high - low);
  EXPECT_LT(high - low, 1.0);
}

TEST_F(KinectTest, ClockThatJumpsIsFollowed) {
  KinectBench bench(1);
  bench.run(12.0);
  {
    const std::lock_guard hold(VirtualTime::instance().mutex());
    bench.unit(0).jump_clock(-3.7);
  }
  bench.run(1.0);
  const HostTime last = bench.log(0).good.back().instant;
  EXPECT_GT(last.time_since_epoch().count(), VirtualTime::instance().now() - 150'000'000);
  EXPECT_EQ(bench.sensor(0).counters().resets, 0U);
  EXPECT_EQ(bench.sensor(0).counters().damaged, 0U);
}

}  // namespace
}  // namespace wagonsight::device
