#pragma once

#include <coroutine>
#include <exception>
#include <functional>
#include <limits>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include <Eigen/Dense>

/// Searches for the minimum of a function, which ask for its values.
namespace tribotwin::twin {

/// Slope and (Gauss-Newton's) positive semidefinite curvature at a point.
struct Quadratic {
  Eigen::VectorXd gradient;
  Eigen::MatrixXd curvature;
};

struct Minimum {
  Eigen::VectorXd z;
  double objective = std::numeric_limits<double>::infinity();
  int evaluations = 0;
};

struct Trial {
  std::vector<Eigen::VectorXd> points;  ///< whose values are asked for
  double step = 0;                      ///< above 0: not the value, but the Quadratic at the only point is asked for
};
struct Tried {
  std::vector<double> values;
  Quadratic quadratic;
};

/// A coroutine that stops at each `co_await trial` until it has the answer. What answers may run anywhere, many
/// searches at once. The first question is there from the beginning.
class Search {
 public:
  class promise_type {
   public:
    Search get_return_object() { return Search(Handle::from_promise(*this)); }
    std::suspend_never initial_suspend() const noexcept { return {}; }
    std::suspend_always final_suspend() const noexcept { return {}; }
    void return_value(Minimum outcome) { outcome_ = std::move(outcome); }
    void unhandled_exception() { failure_ = std::current_exception(); }

    struct Wait {
      promise_type& promise;
      bool await_ready() const noexcept { return false; }
      void await_suspend(std::coroutine_handle<>) const noexcept {}
      Tried await_resume() const { return std::move(*promise.answer_); }
    };
    Wait await_transform(Trial question) {
      question_ = std::move(question);
      return {*this};
    }

   private:
    friend Search;
    std::optional<Trial> question_;
    std::optional<Tried> answer_;
    std::optional<Minimum> outcome_;
    std::exception_ptr failure_;
  };

  Search(Search&& other) noexcept : handle_(std::exchange(other.handle_, {})) {}
  Search& operator=(Search&& other) noexcept {
    std::swap(handle_, other.handle_);
    return *this;
  }
  ~Search() {
    if (handle_) handle_.destroy();
  }

  bool over() const { return handle_.done(); }
  /// Before it is over.
  const Trial& question() const { return *handle_.promise().question_; }
  /// Goes on to the next question or to the end.
  void answer(Tried answer) {
    handle_.promise().answer_ = std::move(answer);
    handle_.resume();
  }
  /// When it is over; throws what has ended it.
  const Minimum& outcome() const {
    const promise_type& promise = handle_.promise();
    if (promise.failure_) std::rethrow_exception(promise.failure_);
    return *promise.outcome_;
  }

 private:
  using Handle = std::coroutine_handle<promise_type>;
  explicit Search(Handle handle) : handle_(handle) {}
  Handle handle_;
};

/// Answers all questions of a search, one after the other.
inline Minimum answered(Search search, const std::function<double(const Eigen::VectorXd&)>& objective,
                        const std::function<Quadratic(const Eigen::VectorXd&, double step)>& quadratic = {}) {
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

/// Where a function with one maximum between `low` and `high` is largest, to `precision` (above 0).
template <class Function>
double golden_section(const Function& value, double low, double high, double precision) {
  constexpr double golden = std::numbers::phi - 1;
  double a = high - golden * (high - low), b = low + golden * (high - low);
  double at_a = value(a), at_b = value(b);
  while (high - low > precision) {
    if (at_a < at_b) {
      low = a, a = b, at_a = at_b;
      at_b = value(b = low + golden * (high - low));
    } else {
      high = b, b = a, at_b = at_a;
      at_a = value(a = high - golden * (high - low));
    }
  }
  return (low + high) / 2;
}

}  // namespace tribotwin::twin
