#include "calibrate/stamp_delays.h"

#include <ceres/ceres.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numeric>

namespace wagonsight {
namespace {

using Eigen::Vector3d;

constexpr double kGap_s = 0.2;  // a target that was not seen for so long was not followed

// ---- who can be compared with whom

// The speed about a sample, by those around it: some of them, or the noise alone would be fast. 0
// where there are none near.
double speed_at(const TargetTrack& track, std::size_t i) {
  constexpr std::size_t kAround = 2;
  const std::size_t a = i - std::min(i, kAround),
                    b = std::min(i + kAround, track.samples.size() - 1);
  const double dt = track.samples[b].t_s - track.samples[a].t_s;
  if (dt <= 0 || dt > 2 * kGap_s) return 0;
  return (track.samples[b].p_W - track.samples[a].p_W).norm() / dt;
}

// Samples of `a` in which the target moved while `b` followed it, too.
int moving_together(const TargetTrack& a, const TargetTrack& b, double speed_min) {
  int count = 0;
  for (std::size_t i = 0; i < a.samples.size(); ++i) {
    const double t = a.samples[i].t_s;
    const auto after =
        std::lower_bound(b.samples.begin(), b.samples.end(), t,
                         [](const TargetSample& sample, double when) { return sample.t_s < when; });
    if (after == b.samples.begin() || after == b.samples.end()) continue;
    const bool followed = after->t_s - (after - 1)->t_s < kGap_s;
    count += followed && speed_at(a, i) > speed_min ? 1 : 0;
  }
  return count;
}

std::string names_of(std::span<const TargetTrack> tracks, const std::vector<bool>& wanted) {
  std::string names;
  for (std::size_t i = 0; i < tracks.size(); ++i)
    if (wanted[i]) names += fmt::format("{}{}", names.empty() ? "" : ", ", tracks[i].name);
  return names;
}

Result<void> check_overlap(std::span<const TargetTrack> tracks, const StampDelayOptions& options) {
  const auto any = [](const std::vector<bool>& flags) {
    return std::find(flags.begin(), flags.end(), true) != flags.end();
  };
  const std::size_t n = tracks.size();
  if (n < 2) return fail("one sensor alone has no delay against others; record two or more");
  std::vector<bool> blind(n), still(n);
  for (std::size_t i = 0; i < n; ++i) {
    int moving = 0;
    for (std::size_t k = 0; k < tracks[i].samples.size(); ++k)
      moving += speed_at(tracks[i], k) > options.moving_mps_min ? 1 : 0;
    const bool seen = static_cast<int>(tracks[i].samples.size()) >= options.moving_samples_min;
    blind[i] = !seen;
    still[i] = seen && moving < options.moving_samples_min;
  }
  if (any(blind))
    return fail(
        fmt::format("the target was hardly seen by {}; wave it in their view, not farther "
                    "than 3 m away, or name its true radius",
                    names_of(tracks, blind)));
  if (any(still))
    return fail(
        fmt::format("the target did not move enough before {}; wave it to and fro, a "
                    "metre a second or faster, for ten seconds",
                    names_of(tracks, still)));
  // Everybody who is tied to the first sensor, directly or by others.
  std::vector<bool> apart(n, true);
  std::vector<std::size_t> reached{0};
  apart[0] = false;
  for (std::size_t next = 0; next < reached.size(); ++next)
    for (std::size_t i = 0; i < n; ++i) {
      if (!apart[i] ||
          std::min(moving_together(tracks[reached[next]], tracks[i], options.moving_mps_min),
                   moving_together(tracks[i], tracks[reached[next]], options.moving_mps_min)) <
              options.moving_samples_min)
        continue;
      apart[i] = false;
      reached.push_back(i);
    }
  if (!any(apart)) return {};
  std::vector<bool> tied(n);
  std::transform(apart.begin(), apart.end(), tied.begin(), [](bool one) { return !one; });
  return fail(
      fmt::format("{} never saw the moving target together with {}; wave it where their "
                  "views overlap",
                  names_of(tracks, apart), names_of(tracks, tied)));
}

// ---- the joint fit

// p = P(t - delay) + offset, in units of sigma. The knots are those about the time by the delay of
// before, so within one solution the time may lie a little outside of them.
struct SampleResidual {
  Vector3d p_W;
  double t;  // of the stamp behind the first knot's interval, in knots
  double per_knot;
  double weight;

  template <class T>
  bool operator()(const T* c0, const T* c1, const T* c2, const T* c3, const T* delay,
                  const T* offset, T* residual) const {
    const T u = T(t) - delay[0] * T(per_knot), u2 = u * u, u3 = u2 * u;
    const T b0 = (T(1) - u) * (T(1) - u) * (T(1) - u) / T(6);
    const T b1 = (T(3) * u3 - T(6) * u2 + T(4)) / T(6);
    const T b2 = (T(-3) * u3 + T(3) * u2 + T(3) * u + T(1)) / T(6);
    const T b3 = u3 / T(6);
    for (int k = 0; k < 3; ++k)
      residual[k] =
          T(weight) * (b0 * c0[k] + b1 * c1[k] + b2 * c2[k] + b3 * c3[k] + offset[k] - T(p_W[k]));
    return true;
  }
};

// A target has no more than so much acceleration.
struct BendResidual {
  double weight;

  template <class T>
  bool operator()(const T* a, const T* b, const T* c, T* residual) const {
    for (int k = 0; k < 3; ++k) residual[k] = T(weight) * (a[k] - T(2) * b[k] + c[k]);
    return true;
  }
};

class JointFit {
 public:
  JointFit(std::span<const TargetTrack> tracks, const StampDelayOptions& options)
      : tracks_(tracks),
        options_(options),
        delays_(tracks.size()),
        offsets_(tracks.size(), {0, 0, 0}),
        sigmas_(tracks.size(), kFirstSigma_m),
        rms_(tracks.size()) {
    begin_ = tracks[0].samples.front().t_s;
    for (const TargetTrack& track : tracks) begin_ = std::min(begin_, track.samples.front().t_s);
    reference_ =
        static_cast<std::size_t>(std::max_element(tracks.begin(), tracks.end(),
                                                  [](const TargetTrack& a, const TargetTrack& b) {
                                                    return a.samples.size() < b.samples.size();
                                                  }) -
                                 tracks.begin());
  }

  Result<std::vector<SensorDelay>> run() {
    constexpr int kRounds = 6;
    for (int round = 0; round < kRounds; ++round) {
      const bool is_last = round + 1 == kRounds;
      if (auto solved = solve(is_last); !solved) return tl::unexpected(solved.error());
      measure_sigmas();
    }
    return results();
  }

 private:
  using Point = std::array<double, 3>;
  static constexpr double kFirstSigma_m = 0.02, kLeastSigma_m = 5e-4;

  double knots_at(std::size_t track, double t_s) const {
    return (t_s - delays_[track] - begin_) / options_.knot_s;
  }
  // The control point of that number; begins where the sample is that asks for it first.
  Point& control(long index, const Vector3d& near) {
    return controls_.try_emplace(index, Point{near.x(), near.y(), near.z()}).first->second;
  }

  void add_samples(ceres::Problem& problem) {
    constexpr double kRobust = 3;  // sigmas
    const double per_knot = 1 / options_.knot_s;
    for (std::size_t i = 0; i < tracks_.size(); ++i)
      for (const TargetSample& sample : tracks_[i].samples) {
        const long first = static_cast<long>(std::floor(knots_at(i, sample.t_s)));
        std::array<double*, 4> knots{};
        for (long k = 0; k < 4; ++k)
          knots[static_cast<std::size_t>(k)] = control(first + k, sample.p_W).data();
        auto* cost =
            new ceres::AutoDiffCostFunction<SampleResidual, 3, 3, 3, 3, 3, 1, 3>(new SampleResidual{
                sample.p_W, (sample.t_s - begin_) * per_knot - static_cast<double>(first), per_knot,
                1 / sigmas_[i]});
        problem.AddResidualBlock(cost, new ceres::HuberLoss(kRobust), knots[0], knots[1], knots[2],
                                 knots[3], &delays_[i], offsets_[i].data());
      }
  }

  void add_bends(ceres::Problem& problem) {
    const double bend_m = options_.acceleration_mps2 * options_.knot_s * options_.knot_s;
    for (auto& [index, point] : controls_) {
      const auto second = controls_.find(index + 1), third = controls_.find(index + 2);
      if (second == controls_.end() || third == controls_.end()) continue;
      problem.AddResidualBlock(
          new ceres::AutoDiffCostFunction<BendResidual, 3, 3, 3, 3>(new BendResidual{1 / bend_m}),
          nullptr, point.data(), second->second.data(), third->second.data());
    }
  }

  Result<void> solve(bool with_covariance) {
    ceres::Problem problem;
    controls_.clear();
    add_samples(problem);
    add_bends(problem);
    problem.SetParameterBlockConstant(&delays_[reference_]);
    problem.SetParameterBlockConstant(offsets_[reference_].data());
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    options.max_num_iterations = 30;
    options.logging_type = ceres::SILENT;
    options.num_threads = 1;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    if (!summary.IsSolutionUsable())
      return fail(fmt::format("the target's way cannot be fitted: {}", summary.message));
    return with_covariance ? compute_covariance(problem) : Result<void>{};
  }

  // Of the delays, the reference's is zero.
  Result<void> compute_covariance(ceres::Problem& problem) {
    const std::size_t n = tracks_.size();
    covariance_.setZero(static_cast<Eigen::Index>(n), static_cast<Eigen::Index>(n));
    ceres::Covariance::Options options;
    options.algorithm_type = ceres::SPARSE_QR;
    options.num_threads = 1;
    ceres::Covariance covariance(options);
    std::vector<std::pair<const double*, const double*>> wanted;
    for (std::size_t i = 0; i < n; ++i)
      for (std::size_t k = i; k < n; ++k)
        if (i != reference_ && k != reference_) wanted.emplace_back(&delays_[i], &delays_[k]);
    if (!covariance.Compute(wanted, &problem))
      return fail(
          "the delays cannot be told from the target's way; wave it differently, in all "
          "directions");
    for (std::size_t i = 0; i < n; ++i)
      for (std::size_t k = 0; k < n; ++k) {
        if (i == reference_ || k == reference_) continue;
        double value = 0;
        covariance.GetCovarianceBlock(&delays_[i], &delays_[k], &value);
        covariance_(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) = value;
      }
    return {};
  }

  // Robust: the median of what is left over, a coordinate. The spline took some of the noise: as
  // much as it has numbers. No sensor counts as better than all together, or the spline would
  // follow that one alone and nothing be left over of it.
  void measure_sigmas() {
    std::size_t values = 0;
    for (const TargetTrack& track : tracks_) values += 3 * track.samples.size();
    const double freedom =
        std::max(0.2, 1 - static_cast<double>(3 * controls_.size()) / static_cast<double>(values));
    std::vector<double> all;
    for (std::size_t i = 0; i < tracks_.size(); ++i) {
      std::vector<double> left;
      for (const TargetSample& sample : tracks_[i].samples) {
        const Vector3d off = left_over(i, sample);
        for (int k = 0; k < 3; ++k) left.push_back(std::abs(off[k]));
      }
      all.insert(all.end(), left.begin(), left.end());
      rms_[i] = sigma_of(left) / std::sqrt(freedom);
    }
    const double together = std::max(kLeastSigma_m, sigma_of(all) / std::sqrt(freedom));
    for (std::size_t i = 0; i < tracks_.size(); ++i) sigmas_[i] = std::max(rms_[i], together);
  }

  static double sigma_of(std::vector<double>& off) {
    constexpr double kOfMedian = 1.4826;
    const auto middle = off.begin() + static_cast<std::ptrdiff_t>(off.size() / 2);
    std::nth_element(off.begin(), middle, off.end());
    return kOfMedian * *middle;
  }

  Vector3d left_over(std::size_t track, const TargetSample& sample) const {
    const long first = static_cast<long>(std::floor(knots_at(track, sample.t_s)));
    std::array<const double*, 4> knots{};
    for (long k = 0; k < 4; ++k) {
      const auto found = controls_.find(first + k);
      if (found == controls_.end()) return Vector3d::Zero();  // moved by a knot: the border alone
      knots[static_cast<std::size_t>(k)] = found->second.data();
    }
    const double per_knot = 1 / options_.knot_s;
    const SampleResidual residual{
        sample.p_W, (sample.t_s - begin_) * per_knot - static_cast<double>(first), per_knot, 1};
    Vector3d off;
    residual(knots[0], knots[1], knots[2], knots[3], &delays_[track], offsets_[track].data(),
             off.data());
    return off;
  }

  Result<std::vector<SensorDelay>> results() const {
    const std::size_t n = tracks_.size();
    const double earliest = *std::min_element(delays_.begin(), delays_.end());
    Vector3d mean = Vector3d::Zero();
    for (const Point& offset : offsets_)
      mean += Eigen::Map<const Vector3d>(offset.data()) / static_cast<double>(n);
    std::vector<SensorDelay> results(n);
    std::vector<bool> uncertain(n);
    double worst = 0;
    for (std::size_t i = 0; i < n; ++i) {
      SensorDelay& told = results[i];
      told.delay_s = delays_[i] - earliest;
      Eigen::VectorXd against_mean =
          Eigen::VectorXd::Constant(static_cast<Eigen::Index>(n), -1.0 / static_cast<double>(n));
      against_mean[static_cast<Eigen::Index>(i)] += 1;
      told.sigma_s = std::sqrt(against_mean.dot(covariance_ * against_mean));
      told.offset_W = Eigen::Map<const Vector3d>(offsets_[i].data()) - mean;
      told.samples = static_cast<int>(tracks_[i].samples.size());
      told.rms_m = rms_[i];
      uncertain[i] = !(told.sigma_s <= options_.sigma_max_s);
      worst = std::max(worst, told.sigma_s);
    }
    if (std::find(uncertain.begin(), uncertain.end(), true) != uncertain.end())
      return fail(
          fmt::format("the delay of {} is known to {:.1f} ms only; wave the target longer "
                      "and faster in their view",
                      names_of(tracks_, uncertain), 1e3 * worst));
    return results;
  }

  std::span<const TargetTrack> tracks_;
  StampDelayOptions options_;
  std::vector<double> delays_;
  std::vector<Point> offsets_;
  std::vector<double> sigmas_;  // of a coordinate, by track: what it is weighed with
  std::vector<double> rms_;     // what is left over of it
  std::map<long, Point> controls_;
  Eigen::MatrixXd covariance_;
  double begin_ = 0;
  std::size_t reference_ = 0;
};

}  // namespace

Result<std::vector<SensorDelay>> estimate_stamp_delays(std::span<const TargetTrack> tracks,
                                                       const StampDelayOptions& options) {
  if (auto comparable = check_overlap(tracks, options); !comparable)
    return tl::unexpected(comparable.error());
  return JointFit(tracks, options).run();
}

}  // namespace wagonsight
