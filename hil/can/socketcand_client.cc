#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <deque>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>

#include <fmt/format.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>

#include <tribotwin/hil/can/clock.hpp>
#include <tribotwin/hil/can/socketcand_protocol.hpp>
#include <tribotwin/hil/can/transport.hpp>
#include <tribotwin/hil/can/wait_any.hpp>
#include <tribotwin/hil/can/words.hpp>
#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/twin/io/descriptor.hpp>

/// The client's side of socketcand's protocol: https://github.com/linux-can/socketcand/blob/master/doc/protocol.md.
namespace tribotwin::hil {
namespace {

using twin::Descriptor;

constexpr std::int64_t second_ns = 1'000'000'000;
constexpr std::int64_t open_patience_ns = 3 * second_ns;  // for a gateway that is there
constexpr std::int64_t retry_ns = second_ns;              // after a connection was lost
constexpr std::size_t max_command = 256, max_queue = 65'536;
constexpr int kernel_queue = 64 * 1024;      // the default grows to megabytes: seconds of stale frames
constexpr unsigned answer_within_ms = 3000;  // what is sent must be acknowledged

struct Endpoint {
  sockaddr_storage storage{};
  socklen_t size = 0;
};

/// The first address of a host.
Result<Endpoint> resolve(const std::string& host, int port) {
  addrinfo wanted{}, *found = nullptr;
  wanted.ai_socktype = SOCK_STREAM;
  if (const int error = ::getaddrinfo(host.c_str(), std::to_string(port).c_str(), &wanted, &found); error != 0)
    return tl::unexpected(Error(fmt::format("unknown host ({})", ::gai_strerror(error))));
  const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> owner(found, ::freeaddrinfo);
  Endpoint endpoint;
  endpoint.size = found->ai_addrlen;
  std::memcpy(&endpoint.storage, found->ai_addr, found->ai_addrlen);
  return endpoint;
}

/// One bus of a gateway. A connection that is lost is tried again every second.
class Client final : public Transport, public Pollable {
 public:
  Client(const std::string& bus, const OpenOptions& options, const Endpoint& gateway, std::string address)
      : Transport(bus), options_(options), gateway_(gateway), address_(std::move(address)) {
    connect();
  }

  /// Waits until frames can be sent. Fails with what the gateway said, or did not say.
  Result<void> open() {
    const std::int64_t until_ns = clock_ns() + open_patience_ns;
    while (!up()) {
      if (!refusal_.empty()) return tl::unexpected(Error(refusal_));
      if (clock_ns() >= until_ns) return tl::unexpected(Error("no answer within 3 s; is a socketcand running there?"));
      wait(until_ns);
      serve();
    }
    return {};
  }

  Sent send(const Frame& frame) override {
    if (options_.listen_only || frame.fd || frame.remote || frame.error || !valid_size(false, frame.size) ||
        frame.id > (frame.extended ? 0x1FFFFFFFu : 0x7FFu)) {
      ++counters_.send_refused;
      return Sent::refused;
    }
    if (!up()) {
      ++counters_.send_down;
      return Sent::down;
    }
    const std::string command = socketcand::send_command(frame);
    if (out_.size() + command.size() > max_queue) {
      ++counters_.send_busy;
      return Sent::busy;
    }
    out_ += command;
    flush();
    ++counters_.sent;
    return Sent::done;
  }

  bool receive(Frame& frame) override {
    if (inbox_.empty()) serve();
    if (inbox_.empty()) return false;
    frame = inbox_.front();
    inbox_.pop_front();
    ++counters_.received;
    return true;
  }

  void wait(std::int64_t deadline_ns) override {
    if (!inbox_.empty()) return;
    const std::int64_t now_ns = clock_ns();
    const auto left_ns = std::max<std::int64_t>(wake_ns(deadline_ns) - now_ns, 0);
    const timespec timeout{.tv_sec = left_ns / second_ns, .tv_nsec = left_ns % second_ns};
    pollfd polled = awaited();
    ::ppoll(&polled, 1, &timeout, nullptr);
    if (polled.revents != 0 || !up()) serve();
  }

  std::int64_t watch(std::vector<pollfd>& polled, std::int64_t deadline_ns) override {
    polled.push_back(awaited());
    return inbox_.empty() ? wake_ns(deadline_ns) : 0;
  }

  bool up() const override { return phase_ == Phase::raw; }

  std::string state() const override {
    if (up()) return fmt::format("bus {} of the gateway {}", name_, address_);
    return fmt::format("the gateway {} is not connected{}{}", address_, refusal_.empty() ? "" : ": ", refusal_);
  }

 private:
  enum class Phase { connecting, greeting, opening, switching, raw };

  std::int64_t wake_ns(std::int64_t deadline_ns) const {
    return up() ? deadline_ns : std::min(deadline_ns, socket_ < 0 ? retry_at_ns_ : joined_by_ns_ + 1);
  }
  pollfd awaited() const {
    const bool sending = phase_ == Phase::connecting || !out_.empty();
    return {.fd = socket_.get(), .events = static_cast<short>(sending ? POLLIN | POLLOUT : POLLIN), .revents = 0};
  }

  void connect() {
    phase_ = Phase::connecting;
    in_.clear();
    out_.clear();
    refusal_.clear();
    socket_ = Descriptor(::socket(gateway_.storage.ss_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
    const int on = 1;
    ::setsockopt(socket_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    ::setsockopt(socket_, SOL_SOCKET, SO_SNDBUF, &kernel_queue, sizeof kernel_queue);
    ::setsockopt(socket_, IPPROTO_TCP, TCP_USER_TIMEOUT, &answer_within_ms, sizeof answer_within_ms);
    joined_by_ns_ = clock_ns() + open_patience_ns;
    if (::connect(socket_, reinterpret_cast<const sockaddr*>(&gateway_.storage), gateway_.size) != 0 &&
        errno != EINPROGRESS)
      lose(std::strerror(errno));
  }

  void lose(const std::string& why) {
    if (up()) ++counters_.link_losses;
    refusal_ = without_controls(why);
    phase_ = Phase::connecting;
    socket_ = Descriptor();
    retry_at_ns_ = clock_ns() + retry_ns;
  }

  /// One round: connects again, sends, reads.
  void serve() {
    if (socket_ < 0) {
      if (clock_ns() < retry_at_ns_) return;
      connect();
    }
    if (phase_ == Phase::connecting && !connected()) return check_patience();
    flush();
    read();
    check_patience();
  }

  void check_patience() {
    if (!up() && socket_ >= 0 && clock_ns() > joined_by_ns_) lose("no answer within 3 s");
  }

  bool connected() {
    pollfd polled{.fd = socket_.get(), .events = POLLOUT, .revents = 0};
    if (socket_ < 0 || ::poll(&polled, 1, 0) <= 0) return false;
    int error = 0;
    socklen_t size = sizeof error;
    ::getsockopt(socket_, SOL_SOCKET, SO_ERROR, &error, &size);
    if (error != 0) return lose(std::strerror(error)), false;
    phase_ = Phase::greeting;
    return true;
  }

  void read() {
    std::array<char, 4096> buffer;
    if (socket_ < 0) return;
    const auto n = ::recv(socket_, buffer.data(), buffer.size(), 0);
    if (n < 0 && (errno == EAGAIN || errno == EINTR)) return;
    if (n <= 0) return lose(n == 0 ? "the gateway has closed the connection" : std::strerror(errno));
    in_.append(buffer.data(), static_cast<std::size_t>(n));
    std::size_t used = 0;
    for (;;) {
      const auto begin = in_.find('<', used), end = in_.find('>', std::min(begin, in_.size()));
      if (end == in_.npos) break;
      obey(std::string_view(in_).substr(begin + 1, end - begin - 1));
      if (socket_ < 0) return;
      used = end + 1;
    }
    in_.erase(0, used);
    if (in_.size() > max_command) lose("this is not the socketcand protocol");
  }

  void obey(std::string_view command) {
    const auto parts = words(command);
    const std::string_view verb = parts.empty() ? "" : parts[0];
    if (verb == "hi" && phase_ == Phase::greeting)
      proceed(Phase::opening, fmt::format("< open {} >", name_));
    else if (verb == "ok" && phase_ == Phase::opening)
      proceed(Phase::switching, "< rawmode >");
    else if (verb == "ok" && phase_ == Phase::switching)
      phase_ = Phase::raw;
    else if (verb == "frame" && up())
      take(socketcand::parse_frame(parts));
    else if (verb == "error" && up() && parts.size() > 1 && to_integer<std::uint32_t>(parts[1], 16))
      ++counters_.error_frames;  // < error CLASS sec.usec >: of the controller
    else if (verb == "error")
      lose(fmt::format("the gateway says:{}", command.substr(command.find("error") + 5)));
    else
      ++counters_.malformed;
  }

  void proceed(Phase next, std::string_view command) {
    phase_ = next;
    out_ += command;
    flush();
  }

  void take(const std::optional<Frame>& frame) {
    if (!frame) {
      ++counters_.malformed;
      return;
    }
    const auto& wanted = options_.identifiers;
    if (wanted.empty() || (!frame->extended && std::ranges::find(wanted, frame->id) != wanted.end()))
      inbox_.push_back(*frame);
  }

  void flush() {
    if (out_.empty() || socket_ < 0) return;
    const auto n = ::send(socket_, out_.data(), out_.size(), MSG_NOSIGNAL);
    if (n > 0) out_.erase(0, static_cast<std::size_t>(n));
    if (n < 0 && errno != EAGAIN && errno != EINTR) lose(std::strerror(errno));
  }

  OpenOptions options_;
  Endpoint gateway_;
  std::string address_;
  Descriptor socket_;
  Phase phase_ = Phase::connecting;
  std::string in_, out_, refusal_;
  std::deque<Frame> inbox_;
  std::int64_t retry_at_ns_ = 0, joined_by_ns_ = 0;
};

}  // namespace

Result<std::unique_ptr<Transport>> open_gateway(const std::string& host, int port, const std::string& bus,
                                                const OpenOptions& options) {
  const std::string address = fmt::format("{}:{}", host.find(':') == host.npos ? host : '[' + host + ']', port);
  const auto fail = [&](const std::string& why) {
    return tl::unexpected(Error(fmt::format("gateway://{}/{}: {}", address, bus, why)));
  };
  if (words(bus) != std::vector<std::string_view>{bus} || bus.find_first_of("<>") != bus.npos)
    return fail("the name of the bus must be one word without < and >");
  if (port < 1 || port > 65535) return fail("the port must be 1..65535; socketcand's is 29536");
  if (options.fd) return fail("socketcand carries classic frames only; for FD use a SocketCAN interface");
  const auto endpoint = resolve(host, port);
  if (!endpoint) return fail(endpoint.error().message);
  auto client = std::make_unique<Client>(bus, options, *endpoint, address);
  if (const auto ok = client->open(); !ok) return fail(ok.error().message);
  return client;
}

}  // namespace tribotwin::hil
