#pragma once

#include <coroutine>
#include <exception>
#include <optional>
#include <utility>

namespace tribotwin::twin {

/// A computation that asks: a coroutine that stops at each `co_await question` until it has the answer. What answers
/// may run anywhere, many such computations at once. The first question is there from the beginning.
template <class Question, class Answer, class Outcome>
class Inquiry {
 public:
  class promise_type {
   public:
    Inquiry get_return_object() { return Inquiry(Handle::from_promise(*this)); }
    std::suspend_never initial_suspend() const noexcept { return {}; }
    std::suspend_always final_suspend() const noexcept { return {}; }
    void return_value(Outcome outcome) { outcome_ = std::move(outcome); }
    void unhandled_exception() { failure_ = std::current_exception(); }

    struct Wait {
      promise_type& promise;
      bool await_ready() const noexcept { return false; }
      void await_suspend(std::coroutine_handle<>) const noexcept {}
      Answer await_resume() const { return std::move(*promise.answer_); }
    };
    Wait await_transform(Question question) {
      question_ = std::move(question);
      return {*this};
    }

   private:
    friend Inquiry;
    std::optional<Question> question_;
    std::optional<Answer> answer_;
    std::optional<Outcome> outcome_;
    std::exception_ptr failure_;
  };

  Inquiry(Inquiry&& other) noexcept : handle_(std::exchange(other.handle_, {})) {}
  Inquiry& operator=(Inquiry&& other) noexcept {
    std::swap(handle_, other.handle_);
    return *this;
  }
  ~Inquiry() {
    if (handle_) handle_.destroy();
  }

  bool over() const { return handle_.done(); }
  /// Before it is over.
  const Question& question() const { return *handle_.promise().question_; }
  /// Goes on to the next question or to the end.
  void answer(Answer answer) {
    handle_.promise().answer_ = std::move(answer);
    handle_.resume();
  }
  /// When it is over; throws what has ended it.
  const Outcome& outcome() const {
    const promise_type& promise = handle_.promise();
    if (promise.failure_) std::rethrow_exception(promise.failure_);
    return *promise.outcome_;
  }

 private:
  using Handle = std::coroutine_handle<promise_type>;
  explicit Inquiry(Handle handle) : handle_(handle) {}
  Handle handle_;
};

}  // namespace tribotwin::twin
