#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <optional>
#include <span>
#include <string_view>
#include <utility>

#include <arpa/inet.h>
#include <fmt/format.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <tribotwin/hil/can/clock.hpp>
#include <tribotwin/hil/can/socketcand_protocol.hpp>
#include <tribotwin/hil/can/transport.hpp>
#include <tribotwin/hil/can/wait_any.hpp>
#include <tribotwin/hil/can/words.hpp>
#include <tribotwin/twin/io/descriptor.hpp>

/// The server's side of socketcand's protocol: https://github.com/linux-can/socketcand/blob/master/doc/protocol.md.
/// Served are its raw mode, which every client library uses, and of the others only `send` and `echo`.
namespace tribotwin::hil {
namespace {

using twin::Descriptor;

constexpr std::size_t max_clients = 16;
constexpr std::size_t max_command = 256;   // "< send 1FFFFFFF 8 ... >" needs 50
constexpr std::size_t max_queue = 65'536;  // bytes for a client that does not read: about 1400 frames
constexpr int max_dropped = 1000;          // frames that such a client misses before it is closed
constexpr int kernel_queue = 64 * 1024;    // the default grows to megabytes: seconds of stale frames
constexpr std::int64_t ms = 1'000'000;
/// python-can 4.1.0 gives up when a frame arrives in the same read as the `< ok >` to `< rawmode >`. So the frames of
/// a new client are kept until it sends another command or this time has passed.
constexpr std::int64_t first_frames_after_ns = 50 * ms;
constexpr std::int64_t accept_pause_ns = 100 * ms;  // when the process is out of file descriptors

struct Client {
  Descriptor socket;
  std::string in = {}, out = {};
  std::int64_t heard_ns = 0;  ///< its last command, or its connection
  bool open = false, raw = false;
  bool joined = false;               ///< came to raw mode, or sent a frame: may be silent from then on
  bool gone = false;                 ///< removed at the end of the round
  std::int64_t silent_until_ns = 0;  ///< nothing is sent before, see first_frames_after_ns
  int dropped = 0;                   ///< frames in a row
};

class Server final : public Transport, public Pollable {
 public:
  Server(const std::string& bus, const OpenOptions& options, Descriptor listener, std::string address)
      : Transport(bus), options_(options), listener_(std::move(listener)), address_(std::move(address)) {}

  ~Server() override {
    for (auto& client : clients_) {
      client.silent_until_ns = 0;
      flush(client);
    }
  }

  Sent send(const Frame& frame) override {
    if (options_.listen_only || frame.fd || frame.remote || frame.error || !valid_size(false, frame.size) ||
        frame.id > (frame.extended ? 0x1FFFFFFFu : 0x7FFu)) {
      ++counters_.send_refused;
      return Sent::refused;
    }
    Frame stamped = frame;
    stamped.time_ns = clock_ns(CLOCK_REALTIME);
    const auto [listening, taken] = broadcast(stamped, nullptr);
    forget_gone();
    if (listening > 0 && taken == 0) return Sent::busy;
    ++counters_.sent;
    return Sent::done;
  }

  bool receive(Frame& frame) override {
    if (next_ == inbox_.size()) {
      // Returns false once between batches, so that a client that floods the bus cannot hold a loop over receive().
      const bool batch_done = !inbox_.empty();
      inbox_.clear();
      next_ = 0;
      if (batch_done) return false;
      serve();
      if (inbox_.empty()) return false;
    }
    frame = inbox_[next_++];
    ++counters_.received;
    return true;
  }

  void wait(std::int64_t deadline_ns) override {
    while (next_ == inbox_.size()) {
      polled_.clear();
      const auto wake_ns = watch(polled_, deadline_ns);
      const auto left = std::max<std::int64_t>(wake_ns - clock_ns(), 0);
      const timespec timeout{.tv_sec = left / 1'000'000'000, .tv_nsec = left % 1'000'000'000};
      if (::ppoll(polled_.data(), polled_.size(), &timeout, nullptr) < 0) return;  // a signal
      serve();
      if (clock_ns() >= deadline_ns) return;
    }
  }

  std::int64_t watch(std::vector<pollfd>& polled, std::int64_t deadline_ns) override {
    const auto now = clock_ns();
    auto wake_ns = next_ == inbox_.size() ? deadline_ns : 0;
    const bool accepting = now >= accept_after_ns_;
    if (!accepting) wake_ns = std::min(wake_ns, accept_after_ns_);
    polled.push_back({.fd = accepting ? listener_.get() : -1, .events = POLLIN, .revents = 0});
    for (const auto& client : clients_) {
      if (!client.joined) wake_ns = std::min(wake_ns, client.heard_ns + options_.handshake_ns);
      const bool silent = now < client.silent_until_ns;
      if (silent && !client.out.empty()) wake_ns = std::min(wake_ns, client.silent_until_ns);
      const bool sending = !silent && !client.out.empty();
      polled.push_back(
          {.fd = client.socket.get(), .events = static_cast<short>(sending ? POLLIN | POLLOUT : POLLIN), .revents = 0});
    }
    return wake_ns;
  }

  bool up() const override { return true; }

  std::string state() const override {
    return fmt::format("serving bus {} on {}, {} client{}", name_, address_, clients_.size(),
                       clients_.size() == 1 ? "" : "s");
  }

 private:
  /// One round over all sockets, at most one read of each.
  void serve() {
    if (next_ == inbox_.size()) {
      inbox_.clear();
      next_ = 0;
    }
    accept_clients();
    const auto now = clock_ns();
    for (auto& client : clients_) {
      flush(client);
      read(client);
      if (!client.joined && !client.gone && now - client.heard_ns >= options_.handshake_ns)
        drop(client, fmt::format("no open and rawmode for {:g} s", 1e-9 * static_cast<double>(options_.handshake_ns)));
    }
    forget_gone();
  }

  void accept_clients() {
    if (clock_ns() < accept_after_ns_) return;
    for (;;) {
      Descriptor socket(::accept4(listener_.get(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC));
      if (socket.get() < 0) {
        if (errno == EMFILE || errno == ENFILE || errno == ENOMEM || errno == ENOBUFS)
          accept_after_ns_ = clock_ns() + accept_pause_ns;
        if (errno == ECONNABORTED) continue;
        return;
      }
      set_options(socket.get());
      if (clients_.size() == max_clients) make_room();
      clients_.push_back({.socket = std::move(socket), .heard_ns = clock_ns()});
      if (clients_.size() <= max_clients) {
        reply(clients_.back(), "< hi >");
      } else {
        reply(clients_.back(), fmt::format("< error {} clients are connected already >", max_clients));
        clients_.pop_back();
      }
    }
  }

  static void set_options(int socket) {
    const auto set = [&](int level, int name, int value) { ::setsockopt(socket, level, name, &value, sizeof value); };
    set(IPPROTO_TCP, TCP_NODELAY, 1);
    set(SOL_SOCKET, SO_SNDBUF, kernel_queue);
    set(SOL_SOCKET, SO_TIMESTAMPNS, 1);
    // A peer that died without a word (behind a tunnel) is noticed after 25 s.
    set(SOL_SOCKET, SO_KEEPALIVE, 1);
    set(IPPROTO_TCP, TCP_KEEPIDLE, 10);
    set(IPPROTO_TCP, TCP_KEEPINTVL, 5);
    set(IPPROTO_TCP, TCP_KEEPCNT, 3);
    set(IPPROTO_TCP, TCP_USER_TIMEOUT, 25'000);
  }

  /// Drops the connection that has been silent for the longest time without joining the bus, if there is one.
  void make_room() {
    Client* longest = nullptr;
    for (auto& client : clients_)
      if (!client.joined && (!longest || client.heard_ns < longest->heard_ns)) longest = &client;
    if (!longest) return;
    drop(*longest, fmt::format("dropped, because {} clients are connected and this one has not joined", max_clients));
    forget_gone();
  }

  void drop(Client& client, std::string_view why) {
    client.silent_until_ns = 0;
    reply(client, fmt::format("< error {} >", why));
    client.gone = true;
  }

  void read(Client& client) {
    std::array<char, 4096> buffer;
    if (client.gone) return;
    const auto n = receive_bytes(client.socket.get(), buffer);
    // Clients that leave Nagle's algorithm on (python-can) wait for this acknowledgement before they send their next
    // frame.
    const int now = 1;
    ::setsockopt(client.socket.get(), IPPROTO_TCP, TCP_QUICKACK, &now, sizeof now);
    if (n < 0 && (errno == EAGAIN || errno == EINTR)) return;
    if (n <= 0) {
      client.gone = true;
      return;
    }
    client.in.append(buffer.data(), static_cast<std::size_t>(n));
    std::size_t used = 0;
    while (!client.gone) {
      const auto begin = client.in.find('<', used), end = client.in.find('>', std::min(begin, client.in.size()));
      if (end == client.in.npos) break;
      // A peer that does not begin with a command is no client; it may be a browser that a foreign web page directs.
      if (!client.open && !words(std::string_view(client.in).substr(used, begin - used)).empty()) return reject(client);
      obey(client, std::string_view(client.in).substr(begin + 1, end - begin - 1));
      used = end + 1;
    }
    client.in.erase(0, used);
    if (client.in.size() > max_command) reject(client);
  }

  /// As recv; `arrived_ns_` becomes the kernel's time of the last segment read (CLOCK_REALTIME), where it has one.
  ssize_t receive_bytes(int socket, std::span<char> buffer) {
    alignas(cmsghdr) char control[CMSG_SPACE(sizeof(timespec))];
    iovec data{buffer.data(), buffer.size()};
    msghdr message{};
    message.msg_iov = &data;
    message.msg_iovlen = 1;
    message.msg_control = control;
    message.msg_controllen = sizeof control;
    const auto n = ::recvmsg(socket, &message, 0);
    arrived_ns_ = clock_ns(CLOCK_REALTIME);
    for (auto* part = n > 0 ? CMSG_FIRSTHDR(&message) : nullptr; part; part = CMSG_NXTHDR(&message, part)) {
      if (part->cmsg_level != SOL_SOCKET || part->cmsg_type != SCM_TIMESTAMPNS) continue;
      timespec time;
      std::memcpy(&time, CMSG_DATA(part), sizeof time);
      arrived_ns_ = time.tv_sec * std::int64_t{1'000'000'000} + time.tv_nsec;
    }
    return n;
  }

  void reject(Client& client) {
    ++counters_.malformed;
    drop(client, "this is not the socketcand protocol");
  }

  void obey(Client& client, std::string_view command) {
    const auto parts = words(command);
    const std::string_view verb = parts.empty() ? "" : parts[0];
    client.silent_until_ns = 0;  // a client that sends again has read the last answer
    client.heard_ns = clock_ns();
    if (verb == "echo" && parts.size() == 1) {
      reply(client, "< echo >");
    } else if (verb == "open" && parts.size() == 2) {
      if (parts[1] == name_) {
        client.open = true;
        reply(client, "< ok >");
      } else {
        reply(client, fmt::format("< error could not open bus, the one here is {} >", name_));
        client.gone = true;
      }
    } else if (client.open && verb == "rawmode" && parts.size() == 1) {
      reply(client, "< ok >");
      client.raw = client.joined = true;
      client.silent_until_ns = clock_ns() + first_frames_after_ns;
    } else if (client.open && verb == "bcmmode" && parts.size() == 1) {
      client.raw = false;
      client.joined = true;
      reply(client, "< ok >");
    } else if (client.open && verb == "send") {
      auto frame = socketcand::parse_send(parts);
      if (frame) {
        frame->time_ns = arrived_ns_;
        client.joined = true;
        take(*frame, client);
      } else {
        ++counters_.malformed;
        reply(client, "< error a frame is sent as: send ID length byte byte ... >");
      }
    } else {
      ++counters_.malformed;
      reply(client, client.open ? "< error unknown command >" : "< error unknown command, open a bus first >");
    }
  }

  /// A frame of a client goes to our inbox and to the other clients.
  void take(const Frame& frame, const Client& from) {
    const auto& wanted = options_.identifiers;
    if (wanted.empty() || (!frame.extended && std::ranges::find(wanted, frame.id) != wanted.end()))
      inbox_.push_back(frame);
    broadcast(frame, &from);
  }

  struct Reach {
    int listening, taken;
  };
  Reach broadcast(const Frame& frame, const Client* except) {
    Reach reach{0, 0};
    std::string command;
    for (auto& client : clients_) {
      if (!client.raw || client.gone || &client == except) continue;
      if (command.empty()) command = socketcand::frame_command(frame);
      ++reach.listening;
      if (queue(client, command))
        ++reach.taken;
      else
        ++counters_.send_busy;
    }
    return reach;
  }

  void reply(Client& client, std::string_view command) { queue(client, command); }

  /// Queues whole commands only: after a part of one a client would not find the next.
  bool queue(Client& client, std::string_view command) {
    if (client.out.size() + command.size() > max_queue) flush(client);
    if (client.out.size() + command.size() > max_queue) {
      const bool its_fault = clock_ns() >= client.silent_until_ns;
      if (its_fault && ++client.dropped >= max_dropped) client.gone = true;
      return false;
    }
    client.dropped = 0;
    client.out += command;
    flush(client);
    return true;
  }

  void flush(Client& client) {
    if (client.out.empty() || client.gone || clock_ns() < client.silent_until_ns) return;
    const auto n = ::send(client.socket.get(), client.out.data(), client.out.size(), MSG_NOSIGNAL);
    if (n > 0) client.out.erase(0, static_cast<std::size_t>(n));
    if (n < 0 && errno != EAGAIN && errno != EINTR) client.gone = true;
  }

  void forget_gone() {
    std::erase_if(clients_, [](const Client& client) { return client.gone; });
  }

  OpenOptions options_;
  Descriptor listener_;
  std::string address_;
  std::vector<Client> clients_;
  std::vector<Frame> inbox_;  ///< of the last rounds; read up to next_
  std::size_t next_ = 0;
  std::int64_t accept_after_ns_ = 0, arrived_ns_ = 0;
  std::vector<pollfd> polled_;
};

struct Address {
  sockaddr_storage storage{};
  socklen_t size = 0;
};

/// Numeric addresses and "localhost" only: a name server must not decide who can reach this server.
std::optional<Address> loopback(const std::string& host, int port) {
  Address address;
  auto* v4 = reinterpret_cast<sockaddr_in*>(&address.storage);
  if (::inet_pton(AF_INET, host == "localhost" ? "127.0.0.1" : host.c_str(), &v4->sin_addr) == 1) {
    if (ntohl(v4->sin_addr.s_addr) >> 24 != 127) return std::nullopt;
    v4->sin_family = AF_INET;
    v4->sin_port = htons(static_cast<std::uint16_t>(port));
    address.size = sizeof(sockaddr_in);
    return address;
  }
  address = {};
  auto* v6 = reinterpret_cast<sockaddr_in6*>(&address.storage);
  if (::inet_pton(AF_INET6, host.c_str(), &v6->sin6_addr) != 1 || !IN6_IS_ADDR_LOOPBACK(&v6->sin6_addr))
    return std::nullopt;
  v6->sin6_family = AF_INET6;
  v6->sin6_port = htons(static_cast<std::uint16_t>(port));
  address.size = sizeof(sockaddr_in6);
  return address;
}

int port_of(int socket) {
  sockaddr_storage storage{};
  socklen_t size = sizeof storage;
  ::getsockname(socket, reinterpret_cast<sockaddr*>(&storage), &size);
  return ntohs(storage.ss_family == AF_INET6 ? reinterpret_cast<sockaddr_in6*>(&storage)->sin6_port
                                             : reinterpret_cast<sockaddr_in*>(&storage)->sin_port);
}

}  // namespace

Result<std::unique_ptr<Transport>> open_socketcand(const std::string& host, int port, const std::string& bus,
                                                   const OpenOptions& options) {
  const std::string shown_host = host.find(':') == host.npos ? host : '[' + host + ']';
  const auto fail = [&](const std::string& why) {
    return tl::unexpected(Error(fmt::format("socketcand://{}:{}/{}: {}", shown_host, port, bus, why)));
  };
  if (words(bus) != std::vector<std::string_view>{bus} || bus.find_first_of("<>") != bus.npos)
    return fail("the name of the bus must be one word without < and >");
  if (port < 0 || port > 65535) return fail("the port must be 1..65535, or 0 for any that is free");
  if (options.fd) return fail("socketcand carries classic frames only; for FD use a SocketCAN interface");
  const auto address = loopback(host, port);
  if (!address)
    return fail(
        "is no loopback address (127.0.0.1, localhost, ::1); others are not served, because whoever reaches the port "
        "commands the drives");

  Descriptor listener(::socket(address->storage.ss_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  if (listener.get() < 0) return fail(fmt::format("no TCP here ({})", std::strerror(errno)));
  const int on = 1;  // the port is free again after a server has ended, but not while another one listens
  ::setsockopt(listener.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  if (::bind(listener.get(), reinterpret_cast<const sockaddr*>(&address->storage), address->size) != 0 ||
      ::listen(listener.get(), max_clients) != 0) {
    if (errno == EADDRINUSE)
      return fail(fmt::format("port {} is taken by another program; end it or choose another port", port));
    return fail(fmt::format("cannot listen ({})", std::strerror(errno)));
  }
  const auto listening_on = fmt::format("{}:{}", shown_host, port_of(listener.get()));
  return std::make_unique<Server>(bus, options, std::move(listener), listening_on);
}

}  // namespace tribotwin::hil
