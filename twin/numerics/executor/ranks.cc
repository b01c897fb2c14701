#include <algorithm>
#include <bit>
#include <chrono>
#include <thread>

#include <fmt/format.h>

#include <tribotwin/twin/io/output.hpp>
#include <tribotwin/twin/numerics/executor/bytes.hpp>
#include <tribotwin/twin/numerics/executor/ranks.hpp>

namespace tribotwin::twin {
namespace {

std::string packed(const Result<std::string>& outcome) {
  BytesOut out;
  out.put(outcome.has_value());
  if (outcome) return out.put(std::string_view(*outcome)).take();
  return out.put(outcome.error().kind).put(std::string_view(outcome.error().message)).take();
}

Result<std::string> unpacked(BytesIn& in) {
  if (in.get<bool>()) return in.text();
  const auto kind = in.get<ErrorKind>();
  return tl::unexpected(Error(in.text(), kind));
}

void sleep(Pause& pause) { std::this_thread::sleep_for(std::chrono::microseconds(pause.next_us())); }

}  // namespace

long Pause::next_us(long longest_us) {
  const long now = std::min(next_us_, longest_us);
  next_us_ = 2 * now;
  return now;
}

Ranks& ranks() {
  static Ranks all;
  return all;
}

std::string Ranks::name_of(int rank) const {
  const auto host = hosts_.find(rank);
  return host == hosts_.end() ? fmt::format("rank {}", rank) : fmt::format("rank {} ({})", rank, host->second);
}

void Ranks::post(int to, Kind kind, std::string_view bytes) {
  std::string whole(1, static_cast<char>(kind));
  whole += bytes;
  transport_->send(to, whole);
}

void Ranks::forward(const std::string& bytes) {
  const auto own = static_cast<unsigned>(rank()), all = static_cast<unsigned>(size());
  for (unsigned step = own == 0 ? std::bit_ceil(all) : own & (~own + 1); step >>= 1;)
    if (own + step < all) transport_->send(static_cast<int>(own + step), bytes);
}

std::optional<Ranks::Parcel> Ranks::poll() {
  while (auto message = transport_->receive()) {
    const auto kind = static_cast<Kind>(message->bytes.at(0));
    if (kind == Kind::share) {
      forward(message->bytes);
      BytesIn in(std::string_view(message->bytes).substr(1));
      const auto operation = in.get<std::uint64_t>();
      shared_.insert_or_assign(operation, unpacked(in));
      continue;
    }
    if (kind != Kind::leave) return Parcel{message->from, kind, message->bytes.substr(1)};
    BytesIn in(std::string_view(message->bytes).substr(1));
    const int code = in.get<int>();
    left_.push_back({message->from, code, in.text()});
  }
  return std::nullopt;
}

void Ranks::report_left(int code) {
  for (Left& one : left_) {
    if (one.reported || one.code == done || one.code == code) continue;
    one.reported = true;
    report_text(fmt::format("warning: {} failed and rank 0 did not: {}\n", name_of(one.rank), one.message));
  }
}

void Ranks::share(std::uint64_t operation, const Result<std::string>& outcome) {
  if (!several()) return;
  BytesOut out;
  out.put(Kind::share).put(operation);
  forward(out.take() + packed(outcome));
}

std::optional<Result<std::string>> Ranks::shared(std::uint64_t operation) {
  if (auto found = shared_.extract(operation)) return std::move(found.mapped());
  if (shared_.contains(last)) {
    deserted_ = true;
    return work_failed("rank 0 has ended");
  }
  return std::nullopt;
}

Result<std::string> Ranks::from_root(const std::function<Result<std::string>()>& make) {
  const auto operation = begin();
  if (root()) {
    auto outcome = make();
    share(operation, outcome);
    return outcome;
  }
  for (Pause pause;; sleep(pause)) {
    (void)poll();
    if (auto outcome = shared(operation)) return *std::move(outcome);
  }
}

Result<void> Ranks::on_root(const std::function<Result<void>()>& work) {
  return from_root([&] { return work().map([] { return std::string(); }); }).map([](const std::string&) {});
}

bool Ranks::join(const std::string& identity, const std::string& host) {
  if (!several()) return false;
  if (!root()) post(0, Kind::hello, BytesOut().put(std::string_view(identity)).put(std::string_view(host)).take());
  const auto answer = from_root([&]() -> Result<std::string> {
    bool same = true;
    Pause pause;
    while (hosts_.size() + 1 < static_cast<std::size_t>(size())) {
      while (const auto parcel = poll()) {
        BytesIn in(parcel->bytes);
        same = in.text() == identity && same;
        hosts_[parcel->from] = in.text();
      }
      sleep(pause);
    }
    return same ? "together" : "";
  });
  if (answer && !answer->empty()) return true;
  transport_->close();
  transport_.reset();
  return false;
}

void Ranks::leave(int code, const std::string& message) {
  if (!transport_) return;
  Pause pause;
  if (root()) {
    share(last, "");
    for (; left_.size() + 1 < static_cast<std::size_t>(size()); sleep(pause)) (void)poll();
    report_left(code);
  } else {
    post(0, Kind::leave, BytesOut().put(deserted_ ? int{done} : code).put(std::string_view(message)).take());
    for (; !shared_.contains(last); sleep(pause)) (void)poll();
  }
  transport_->close();
  transport_.reset();
}

}  // namespace tribotwin::twin
