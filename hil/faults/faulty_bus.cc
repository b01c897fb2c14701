#include <algorithm>
#include <cmath>
#include <limits>

#include <tribotwin/hil/can/clock.hpp>
#include <tribotwin/hil/faults/faulty_bus.hpp>

namespace tribotwin::hil {

using K = FaultKind;

FaultyBus::FaultyBus(Transport& bus, std::vector<Fault> faults, std::uint64_t seed, std::function<double()> time_s)
    : Transport(bus.name()), bus_(bus), random_(seed), time_s_(std::move(time_s)) {
  for (Fault& fault : faults) faults_.push_back({std::move(fault)});
}

double FaultyBus::now_s() const {
  const double simulated_s = time_s_();
  const std::int64_t ns = clock_ns();
  line_s_ += was_cut_ ? std::max(simulated_s - simulated_s_, 1e-9 * static_cast<double>(ns - asked_ns_))
                      : simulated_s - simulated_s_;
  simulated_s_ = simulated_s;
  asked_ns_ = ns;
  if (line_s_ >= holds_until_s_) look();
  return line_s_;
}

void FaultyBus::look() const {
  due_.clear();
  was_cut_ = false;
  news_ = true;
  holds_until_s_ = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < faults_.size(); ++i) {
    const Fault& f = faults_[i].fault;
    if (is_due(f)) {
      due_.push_back(i);
      was_cut_ |= target_of(f.kind) == FaultTarget::link;
    }
    for (const double change_s : {f.from_s, f.to_s})
      if (change_s > line_s_) holds_until_s_ = std::min(holds_until_s_, change_s);
  }
}

bool FaultyBus::is_due(const Fault& f) const { return line_s_ >= f.from_s && line_s_ < f.to_s; }

bool FaultyBus::hits(const Fault& f, const Frame& frame) {
  // Node numbers are the low seven bits of every identifier that has one.
  if (f.node != 0 && (frame.id < 0x81 || static_cast<int>(frame.id & 0x7f) != f.node)) return false;
  return f.kind == K::silence || std::uniform_real_distribution<double>()(random_) < f.probability;
}

bool FaultyBus::cut() const {
  now_s();
  return was_cut_;
}

void FaultyBus::pass(const Frame& given, std::deque<Frame>& out) {
  Frame frame = given;
  int copies = 1;
  now_s();
  for (const std::size_t i : due_) {
    const Fault& f = faults_[i].fault;
    if (target_of(f.kind) != FaultTarget::frames || !hits(f, frame)) continue;
    if (f.kind == K::drop || f.kind == K::silence) return;
    if (f.kind == K::delay)
      return later_.push_back({clock_ns() + std::llround(1e9 * f.delay_s), frame, &out != &ready_});
    if (f.kind == K::duplicate) ++copies;
    if (f.kind == K::corrupt && frame.size > 0)
      frame.data[random_() % frame.size] ^= static_cast<std::uint8_t>(1U << random_() % 8);
  }
  for (int i = 0; i < copies; ++i) out.push_back(frame);
}

Sent FaultyBus::send(const Frame& frame) {
  if (faults_.empty()) return bus_.send(frame);
  if (cut()) return Sent::down;
  std::deque<Frame> out;
  pass(frame, out);
  Sent sent = Sent::done;  // a frame that is lost on the way counts as sent
  for (const Frame& f : out) sent = bus_.send(f);
  return sent;
}

bool FaultyBus::receive(Frame& frame) {
  if (faults_.empty() && later_.empty() && ready_.empty()) return bus_.receive(frame);
  const std::int64_t now = clock_ns();
  for (auto it = later_.begin(); it != later_.end();) {
    if (it->at_ns > now) {
      ++it;
      continue;
    }
    if (it->outgoing)
      bus_.send(it->frame);
    else
      ready_.push_back(it->frame);
    it = later_.erase(it);
  }
  while (ready_.empty()) {
    Frame next;
    if (!bus_.receive(next)) return false;
    if (!cut()) pass(next, ready_);
  }
  frame = ready_.front();
  ready_.pop_front();
  return true;
}

void FaultyBus::wait(std::int64_t deadline_ns) {
  if (!ready_.empty()) return;
  for (const Later& l : later_) deadline_ns = std::min(deadline_ns, l.at_ns);
  bus_.wait(deadline_ns);
}

std::int64_t FaultyBus::watch(std::vector<pollfd>& polled, std::int64_t deadline_ns) {
  constexpr std::int64_t ask_again_ns = 1'000'000;
  if (!ready_.empty()) return 0;
  for (const Later& l : later_) deadline_ns = std::min(deadline_ns, l.at_ns);
  if (auto* bus = dynamic_cast<Pollable*>(&bus_)) return bus->watch(polled, deadline_ns);
  return std::min(deadline_ns, clock_ns() + ask_again_ns);
}

bool FaultyBus::up() const { return bus_.up() && (faults_.empty() || !cut()); }

std::string FaultyBus::state() const {
  return !faults_.empty() && cut() ? name_ + ": cut by a fault of the list" : bus_.state();
}

bool FaultyBus::is_full() {
  constexpr std::size_t most = 64;
  now_s();
  return due_.size() >= most;
}

void FaultyBus::inject(Fault fault) {
  const double now = now_s();
  fault.to_s = now + (fault.to_s - fault.from_s);
  fault.from_s = now;
  faults_.push_back({fault});
  look();
}

void FaultyBus::prolong_missed() {
  for (auto& [fault, told] : faults_)
    if (target_of(fault.kind) == FaultTarget::drive && !told && line_s_ >= fault.to_s)
      fault.to_s = std::nextafter(line_s_, std::numeric_limits<double>::infinity());
}

std::vector<DriveFault> FaultyBus::changed(int first_node) {
  now_s();
  if (!news_) return {};
  prolong_missed();
  std::vector<DriveFault> changes;
  for (auto& [f, told] : faults_) {
    const bool on = target_of(f.kind) == FaultTarget::drive && is_due(f);
    if (on == told) continue;
    told = on;
    changes.push_back({f.kind, static_cast<std::size_t>(f.node - first_node), on, on ? f.temperature_degC : 0});
  }
  std::erase_if(faults_, [this](const Listed& l) { return line_s_ >= l.fault.to_s && !l.told; });
  look();
  news_ = false;
  return changes;
}

}  // namespace tribotwin::hil
