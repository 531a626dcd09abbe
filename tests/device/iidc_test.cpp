#include <gmock/gmock.h>

#include <algorithm>
#include <cstdio>

#include "iidc_bench.h"

// Real libdc1394, emulated IIDC cameras.
namespace wagonsight::device {
namespace {

using ::testing::HasSubstr;

class IidcTest : public ::testing::Test {
 protected:
  IidcTest() { set_sealed_heap_rule(SealedHeapRule::kAbort); }

  static void expect_all_is_well(const IidcBench& bench, std::size_t unit) {
    const DeviceBench::Balance balance = bench.balance(unit);
    EXPECT_EQ(bench.log(unit).wrong_pixels, 0U) << "unit " << unit;
    EXPECT_EQ(bench.log(unit).unknown, 0U) << "unit " << unit;
    EXPECT_EQ(balance.missing, 0U) << "unit " << unit;
    EXPECT_EQ(balance.delivered_damaged, 0U) << "unit " << unit;
    EXPECT_EQ(balance.repeated, 0U) << "unit " << unit;
  }
  // `damaged_max`: a neighbour on a bus that was reset may have lost the image of that moment.
  static void expect_untouched(const IidcBench& bench, std::size_t unit,
                               std::uint64_t damaged_max = 0) {
    expect_all_is_well(bench, unit);
    EXPECT_LE(bench.sensor(unit).counters().damaged, damaged_max) << "unit " << unit;
    EXPECT_EQ(bench.sensor(unit).counters().dropped, 0U) << "unit " << unit;
    EXPECT_EQ(bench.sensor(unit).counters().resets, 0U) << "unit " << unit;
  }
};

TEST_F(IidcTest, SixRunAtFourteenFramesASecondWithEveryPixelAsItWasSent) {
  IidcBench bench(6);
  bench.run(1.0);  // to open
  std::vector<std::size_t> before;
  for (std::size_t i = 0; i < 6; ++i) before.push_back(bench.log(i).good.size());
  bench.run(5.0);
  for (std::size_t i = 0; i < 6; ++i) {
    expect_untouched(bench, i);
    EXPECT_GE(bench.log(i).good.size() - before[i], 69U) << "unit " << i;
    EXPECT_EQ(bench.thread(i).trouble(), "");
  }
  // What is left of a bus that two of them share.
  EXPECT_GE(FireBuses::instance().bus(0).bandwidth_left, 0);
  EXPECT_GE(bench.sensor(0).rate_hz_planned(), 14.0);
}

// One fault of the cable on one unit; its frames are right or counted, the others' untouched.
void with_packet_fault(const char* name, double IidcFaults::*fault, double share,
                       bool has_counter = true) {
  IidcBench bench(3, [&](std::size_t, IidcUnit::Options& options, IidcOptions&) {
    options.has_counter = has_counter;
  });
  bench.run(1.0);
  bench.faults(1).*fault = share;
  bench.run(8.0);
  bench.faults(1).*fault = 0;
  bench.run(1.0);
  const DeviceBench::Balance balance = bench.balance(1);
  const Sensor::Counters counters = bench.sensor(1).counters();
  std::printf("%s: %zu frames good, %llu damaged, %llu whole ones missing\n", name,
              bench.log(1).good.size(), static_cast<unsigned long long>(counters.damaged),
              static_cast<unsigned long long>(balance.missing));
  EXPECT_EQ(bench.log(1).wrong_pixels, 0U);
  EXPECT_EQ(bench.log(1).unknown, 0U);
  EXPECT_EQ(balance.delivered_damaged, 0U);
  EXPECT_EQ(balance.missing, 0U);
  EXPECT_EQ(balance.repeated, 0U);
  EXPECT_GT(counters.damaged, 10U);
  // Every frame of the device since the first good one was delivered or counted.
  const auto& good = bench.log(1).good;
  const std::uint64_t passed = good.back().number - good.front().number + 1;
  EXPECT_EQ(passed, good.size() + counters.damaged + counters.dropped);
  EXPECT_EQ(counters.resets, 0U);
}

TEST_F(IidcTest, LostPacketsNeverGiveAWrongFrame) {
  with_packet_fault("lost packets, 1 in 1000", &IidcFaults::lost, 1e-3);
}
TEST_F(IidcTest, LostPacketsAreCountedWithoutACounterInTheImage) {
  with_packet_fault("the same, no counter", &IidcFaults::lost, 1e-3, false);
}
TEST_F(IidcTest, TruncatedPacketsNeverGiveAWrongFrame) {
  with_packet_fault("truncated packets, 1 in 1000", &IidcFaults::truncated, 1e-3);
}
TEST_F(IidcTest, GarbageNeverGivesAWrongFrame) {
  with_packet_fault("garbage packets, 1 in 1000", &IidcFaults::garbage, 1e-3);
}

// How a fault that interrupts the stream went, for the table of README.md.
struct Interruption {
  double noticed_s = 0;    // from the fault to the sensor's saying so
  double recovered_s = 0;  // to the next good frame
};
Interruption interrupt(IidcBench& bench, const char* name, const std::function<void()>& fault) {
  bench.run(2.0);
  VirtualTime& time = VirtualTime::instance();
  bench.thread(1).forget_trouble();
  const Nanoseconds begin = time.now();
  fault();
  Interruption seen;
  seen.recovered_s = bench.run_until_frame(1, 60);
  seen.noticed_s = static_cast<double>(bench.thread(1).trouble_since() - begin) * 1e-9;
  bench.run(6.0);
  std::printf(
      "%-40s noticed after %.2f s, frames again after %.2f s; the bus's other one lost "
      "%llu\n",
      name, seen.noticed_s, seen.recovered_s,
      static_cast<unsigned long long>(bench.sensor(0).counters().damaged));
  return seen;
}

TEST_F(IidcTest, StallIsNoticedAndEndedByInitialising) {
  IidcBench bench(3);
  const auto seen = interrupt(bench, "stream stalls", [&] { bench.faults(1).silent = true; });
  EXPECT_LT(seen.noticed_s, 1.0);
  EXPECT_GT(seen.recovered_s, 0);
  EXPECT_LT(seen.recovered_s, 2.0);
  EXPECT_EQ(bench.sensor(1).cures().initialised, 1U);
  EXPECT_EQ(bench.sensor(1).cures().bus_resets, 0U);
  EXPECT_EQ(bench.thread(1).trouble(), "");
  expect_all_is_well(bench, 1);
  expect_untouched(bench, 0);
  expect_untouched(bench, 2);
}

TEST_F(IidcTest, WedgeIsNoticedAndEndedByABusReset) {
  IidcBench bench(3);
  const auto seen = interrupt(bench, "wedged", [&] { bench.faults(1).wedged = true; });
  EXPECT_LT(seen.noticed_s, 1.0);
  EXPECT_GT(seen.recovered_s, 0);
  EXPECT_LT(seen.recovered_s, 6.0);
  EXPECT_EQ(bench.sensor(1).cures().bus_resets, 1U);
  expect_all_is_well(bench, 1);
  expect_untouched(bench, 0, 1);
  expect_untouched(bench, 2);
}

TEST_F(IidcTest, UnplugIsNoticedAndItsReturnToo) {
  IidcBench bench(3);
  const auto unit = bench.shared_unit(1);
  const auto seen = interrupt(bench, "unplugged for 3 s, returns on another bus", [&] {
    FireBuses::instance().unplug(*unit);
    unit->power_cycle();
    DeviceBench::script(3.0, [unit] { FireBuses::instance().plug_locked(unit, 1); });
  });
  EXPECT_LT(seen.noticed_s, 0.1);
  EXPECT_GT(seen.recovered_s, 3.0);
  EXPECT_LT(seen.recovered_s, 4.5);
  EXPECT_EQ(bench.sensor(1).counters().resets, 1U);
  expect_all_is_well(bench, 1);
  expect_untouched(bench, 0, 1);
  expect_untouched(bench, 2, 1);
}

TEST_F(IidcTest, BusResetCostsAtMostTheImageOfThatMoment) {
  IidcBench bench(2);
  bench.run(2.0);
  DeviceBench::script(0.003, [] { FireBuses::instance().reset_bus(0); });
  bench.run(3.0);
  expect_untouched(bench, 0, 1);
  expect_untouched(bench, 1, 1);
}

TEST_F(IidcTest, BuffersThatRanFullLoseWhatIsCountedOnly) {
  IidcBench bench(2);
  bench.run(2.0);
  {
    const std::lock_guard hold(VirtualTime::instance().mutex());
    FireBuses::instance().hold_interrupts(0, VirtualTime::instance().now() + 400'000'000);
  }
  bench.run(4.0);
  for (std::size_t i = 0; i < 2; ++i) {
    expect_all_is_well(bench, i);
    const auto& good = bench.log(i).good;
    const auto counters = bench.sensor(i).counters();
    EXPECT_GT(counters.damaged, 1U);
    EXPECT_EQ(good.back().number - good.front().number + 1, good.size() + counters.damaged);
  }
}

TEST_F(IidcTest, BusyAndRefusedRequestsAreTriedAgain) {
  IidcBench bench(2);
  bench.faults(0).busy_requests = 5;
  bench.faults(1).refused_requests = 3;
  bench.run(4.0);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_GT(bench.log(i).good.size(), 20U);
    EXPECT_EQ(bench.thread(i).trouble(), "");
  }
}

TEST_F(IidcTest, HandshakeThatNeverEndsHoldsNobody) {
  IidcBench bench(2);
  bench.faults(1).endless_handshake = true;
  bench.run(3.0);
  EXPECT_EQ(bench.log(1).good.size(), 0U);
  EXPECT_THAT(bench.thread(1).trouble(), HasSubstr("image format"));
  bench.faults(1).endless_handshake = false;
  EXPECT_GT(bench.run_until_frame(1, 30), 0);
}

TEST_F(IidcTest, PacketsOfAnotherSizeGiveNoFrame) {
  IidcBench bench(1);
  bench.faults(0).wrong_packet_size = true;
  bench.run(5.0);
  EXPECT_EQ(bench.log(0).good.size(), 0U);
  EXPECT_THAT(bench.thread(0).trouble(), HasSubstr("no images"));
}

TEST_F(IidcTest, ImagesOfAnotherSizeAreRefusedInWords) {
  IidcBench bench(1, [](std::size_t, IidcUnit::Options&, IidcOptions& s) { s.width = 640; });
  bench.run(2.0);
  EXPECT_THAT(bench.thread(0).trouble(), HasSubstr("calibrate"));
}

TEST_F(IidcTest, WrongConfigurationRomsCrashNobody) {
  for (const auto rom : {IidcUnit::Rom::kEmptyLeaf, IidcUnit::Rom::kBeyondItsEnd}) {
    IidcBench bench(2, [&](std::size_t unit, IidcUnit::Options& options, IidcOptions&) {
      if (unit == 1) options.rom = rom;
    });
    bench.run(2.0);
    EXPECT_THAT(bench.thread(0).trouble(), HasSubstr("describes itself wrongly"));
    FireBuses::instance().unplug(bench.unit(1));
    EXPECT_GT(bench.run_until_frame(0, 10), 0);
    EXPECT_THAT(bench.thread(1).trouble(), HasSubstr("plugged in"));
  }
}

TEST_F(IidcTest, OtherDevicesOfABusAreNoCameras) {
  IidcBench bench(2, [](std::size_t unit, IidcUnit::Options& options, IidcOptions&) {
    if (unit == 1) options.rom = IidcUnit::Rom::kNoCamera;
  });
  bench.run(2.0);
  EXPECT_GT(bench.log(0).good.size(), 15U);
  EXPECT_THAT(bench.thread(1).trouble(), HasSubstr("plugged in"));
}

TEST_F(IidcTest, FullBusIsSaidAndUsed) {
  IidcBench bench(4);
  bench.run(0.2);
  for (const std::size_t i : {2U, 3U}) {
    FireBuses::instance().unplug(bench.unit(i));
    FireBuses::instance().plug(bench.shared_unit(i), 0);
  }
  bench.run(6.0);
  // The first two keep the share that they took when they were alone.
  EXPECT_THAT(bench.thread(2).trouble(), HasSubstr("card"));
  EXPECT_GT(bench.log(0).good.size(), 60U);
  expect_all_is_well(bench, 0);
}

TEST_F(IidcTest, ShutterAndGainAreSetAndTold) {
  IidcBench bench(1);
  bench.run(1.0);
  bench.sensor(0).set_exposure({4500, 6});
  Exposure last{};
  std::uint64_t between = 0;
  bench.hand_on([&](FrameSlot* slot) {
    last = slot->exposure;
    between += last.shutter_us != 2000 && last.shutter_us != 4500 ? 1U : 0U;
    bench.pool().release(slot);
  });
  bench.run(1.0);
  EXPECT_NEAR(bench.unit(0).shutter_s(), 0.0045, 1e-7);
  EXPECT_NEAR(bench.unit(0).gain_db(), 6, 1e-5);
  EXPECT_NEAR(static_cast<double>(last.shutter_us), 4500, 0.01);
  EXPECT_FLOAT_EQ(last.gain_db, 6);
  expect_untouched(bench, 0);
}

TEST_F(IidcTest, CameraWithoutUnitsOfExposureIsLeftAlone) {
  IidcBench bench(1,
                  [](std::size_t, IidcUnit::Options& o, IidcOptions&) { o.has_absolute = false; });
  bench.sensor(0).set_exposure({4500, 6});
  bool is_told = false;
  bench.hand_on([&](FrameSlot* slot) {
    is_told = is_told || slot->exposure.shutter_us > 0;
    bench.pool().release(slot);
  });
  bench.run(2.0);
  EXPECT_GT(bench.log(0).good.size(), 20U);
  EXPECT_FALSE(is_told);
}

// The instants that are told, less those of the light; all buses drift, and interrupts are late.
TEST_F(IidcTest, InstantsAreKnownToATenthOfAMillisecondUnderDriftAndJitter) {
  IidcBench bench(6);
  for (int bus = 0; bus < 3; ++bus) FireBuses::instance().set_jitter(bus, 5'000'000);
  bench.run(7.0);
  double low = 1e9;
  double high = -1e9;
  for (std::size_t i = 0; i < 6; ++i) {
    const auto& good = bench.log(i).good;
    for (std::size_t n = good.size() / 2; n < good.size(); ++n) {
      const auto instant = good[n].instant.time_since_epoch().count();
      const double off_ms = static_cast<double>(instant - bench.light_of(i, good[n].number)) * 1e-6;
      low = std::min(low, off_ms);
      high = std::max(high, off_ms);
    }
    expect_untouched(bench, i);
  }
  std::printf("30 ppm, 5 ms jitter: instants less light %.3f to %.3f ms\n", low, high);
  EXPECT_GT(low, -0.3);
  EXPECT_LT(high, 0.3);
  EXPECT_LT(high - low, 0.2);
}

}  // namespace
}  // namespace wagonsight::device
