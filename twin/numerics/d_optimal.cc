#include <limits>
#include <optional>

#include <tribotwin/twin/numerics/d_optimal.hpp>
#include <tribotwin/twin/numerics/linear_algebra.hpp>

namespace tribotwin::twin {

double mean_log_sigma(const Eigen::MatrixXd& information) {
  const auto L = cholesky_factor(information);
  if (!L) return std::numeric_limits<double>::infinity();
  return -L->diagonal().array().log().mean();
}

namespace {

class Choice {
 public:
  Choice(const Eigen::MatrixXd& known, std::span<const Experiment> experiments, std::span<const double> group_cost,
         double budget)
      : known_(known),
        experiments_(experiments),
        group_cost_(group_cost.begin(), group_cost.end()),
        left_(budget),
        volume_(mean_log_sigma(known)),
        gain_(experiments.size(), std::numeric_limits<double>::infinity()) {}

  /// The next experiment; none fits, or none adds anything.
  std::optional<std::size_t> next() {
    std::vector<bool> fresh(experiments_.size(), false);
    for (;;) {
      const auto best = most_promising();
      if (!best) return {};
      if (fresh[*best]) return best;
      gain_[*best] = volume_ - mean_log_sigma(known_ + experiments_[*best].information);
      fresh[*best] = true;
    }
  }

  void take(std::size_t one) {
    left_ -= cost(one);
    group_cost_[experiments_[one].group] = 0;
    known_ += experiments_[one].information;
    volume_ = mean_log_sigma(known_);
  }

 private:
  double cost(std::size_t one) const { return experiments_[one].cost + group_cost_[experiments_[one].group]; }

  /// By the gains as last computed, which are upper bounds.
  std::optional<std::size_t> most_promising() const {
    std::optional<std::size_t> best;
    for (std::size_t e = 0; e < experiments_.size(); ++e)
      if (cost(e) <= left_ && gain_[e] > 0 && (!best || gain_[e] / cost(e) > gain_[*best] / cost(*best))) best = e;
    return best;
  }

  Eigen::MatrixXd known_;
  std::span<const Experiment> experiments_;
  std::vector<double> group_cost_;
  double left_, volume_;
  std::vector<double> gain_;
};

}  // namespace

std::vector<std::size_t> d_optimal(const Eigen::MatrixXd& known, std::span<const Experiment> experiments,
                                   std::span<const double> group_cost, double budget) {
  Choice choice(known, experiments, group_cost, budget);
  std::vector<std::size_t> out;
  while (const auto one = choice.next()) {
    choice.take(*one);
    out.push_back(*one);
  }
  return out;
}

}  // namespace tribotwin::twin
