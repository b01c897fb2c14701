#include <utility>

#include <tribotwin/twin/numerics/search.hpp>

namespace tribotwin::twin {

Minimum answered(Search search, const std::function<double(const Eigen::VectorXd&)>& objective,
                 const std::function<Quadratic(const Eigen::VectorXd&, double)>& quadratic) {
  while (!search.over()) {
    const Trial& trial = search.question();
    Tried tried;
    if (trial.step > 0)
      tried.quadratic = quadratic(trial.points.front(), trial.step);
    else
      for (const auto& z : trial.points) tried.values.push_back(objective(z));
    search.answer(std::move(tried));
  }
  return search.outcome();
}

}  // namespace tribotwin::twin
