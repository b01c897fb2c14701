#include <cerrno>
#include <cstring>
#include <optional>
#include <system_error>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <linux/rtnetlink.h>
#include <net/if.h>
#include <net/if_arp.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <tribotwin/hil/can/bit_rate.hpp>
#include <tribotwin/hil/can/clock.hpp>
#include <tribotwin/hil/can/transport.hpp>
#include <tribotwin/hil/can/wait_any.hpp>
#include <tribotwin/twin/io/descriptor.hpp>

namespace tribotwin::hil {
namespace {

using twin::Descriptor;

constexpr int receive_buffer_bytes = 4 << 20;  // the kernel doubles it: about 11,000 frames, 1 s of a full 1 Mbit/s bus
constexpr std::int64_t second_ns = 1'000'000'000;

std::string reason(int error) { return std::generic_category().message(error); }

template <class Value>
bool set_option(int socket, int level, int name, const Value& value) {
  return setsockopt(socket, level, name, &value, sizeof value) == 0;
}

enum class Link { up, no_carrier, down, gone };

struct Interface {
  int index = 0;  ///< 0 if there is none
  bool can = false;
  Link link = Link::gone;
};

/// State of an interface, from the kernel. `socket`: any.
Interface look_up(int socket, const std::string& name) {
  if (name.empty() || name.size() >= IFNAMSIZ) return {};
  Interface found;
  ifreq request{};
  name.copy(request.ifr_name, IFNAMSIZ - 1);
  if (ioctl(socket, SIOCGIFINDEX, &request) != 0) return {};
  found.index = request.ifr_ifindex;
  if (ioctl(socket, SIOCGIFHWADDR, &request) != 0) return {};
  found.can = request.ifr_hwaddr.sa_family == ARPHRD_CAN;
  if (ioctl(socket, SIOCGIFFLAGS, &request) != 0) return {};
  // Without carrier (bus-off) the kernel accepts frames and drops them, so that is not "up".
  found.link = !(request.ifr_flags & IFF_UP)        ? Link::down
               : !(request.ifr_flags & IFF_RUNNING) ? Link::no_carrier
                                                    : Link::up;
  return found;
}

std::string can_interfaces(int socket) {
  std::vector<std::string> names;
  if (auto* const all = if_nameindex()) {
    for (const auto* i = all; i->if_index != 0; ++i) {
      const Interface found = look_up(socket, i->if_name);
      if (found.can) names.push_back(fmt::format("{}{}", i->if_name, found.link == Link::down ? " (down)" : ""));
    }
    if_freenameindex(all);
  }
  if (names.empty())
    return "there is no CAN interface here; `ip link add dev vcan0 type vcan && ip link set vcan0 up` makes a virtual "
           "one";
  return fmt::format("CAN interfaces here: {}", fmt::join(names, ", "));
}

/// The kernel's form of a frame; a socket sends CAN_MTU or CANFD_MTU bytes of it. None if no bus can carry it.
std::optional<canfd_frame> to_kernel(const Frame& frame) {
  if (frame.error || frame.id > (frame.extended ? CAN_EFF_MASK : CAN_SFF_MASK)) return std::nullopt;
  if (!valid_size(frame.fd, frame.size) || (frame.fd && frame.remote)) return std::nullopt;
  canfd_frame raw{};
  raw.can_id = frame.id | (frame.extended ? CAN_EFF_FLAG : 0) | (frame.remote ? CAN_RTR_FLAG : 0);
  raw.len = frame.size;
  if (frame.fd)
    raw.flags = static_cast<__u8>((frame.bit_rate_switch ? CANFD_BRS : 0) | (frame.error_passive ? CANFD_ESI : 0));
  if (!frame.remote) std::copy_n(frame.data.begin(), frame.size, raw.data);
  return raw;
}

Frame from_kernel(const canfd_frame& raw, bool fd) {
  Frame frame;
  frame.error = raw.can_id & CAN_ERR_FLAG;
  frame.extended = !frame.error && raw.can_id & CAN_EFF_FLAG;
  frame.remote = !frame.error && raw.can_id & CAN_RTR_FLAG;
  frame.id = raw.can_id & (frame.extended || frame.error ? CAN_EFF_MASK : CAN_SFF_MASK);
  frame.fd = fd;
  frame.bit_rate_switch = fd && raw.flags & CANFD_BRS;
  frame.error_passive = fd && raw.flags & CANFD_ESI;
  frame.size = raw.len;
  if (!frame.remote) std::copy_n(raw.data, raw.len, frame.data.begin());
  return frame;
}

/// A raw socket on one interface. A change of any link makes `watch_` readable; the state is then queried, not parsed
/// from the message. ENETDOWN and ENODEV do not prove a state: the socket keeps such an error for its next call, even
/// if the link is up again by then.
class SocketCan final : public Transport, public Pollable {
 public:
  SocketCan(std::string name, const OpenOptions& options, Descriptor socket, Descriptor watch)
      : Transport(std::move(name)),
        socket_(std::move(socket)),
        watch_(std::move(watch)),
        fd_(options.fd),
        listen_only_(options.listen_only) {
    for (const std::uint32_t id : options.identifiers)
      filters_.push_back({.can_id = id, .can_mask = CAN_SFF_MASK | CAN_EFF_FLAG | CAN_RTR_FLAG});
    if (filters_.empty()) filters_.push_back({.can_id = 0, .can_mask = 0});
  }

  /// Receives from and sends to the interface with this index. Fails with errno.
  bool bind(int index) {
    sockaddr_can address{};
    address.can_family = AF_CAN;
    address.can_ifindex = index;
    // A deleted device takes the filters with it.
    const auto filter_bytes = static_cast<socklen_t>(filters_.size() * sizeof(can_filter));
    return setsockopt(socket_, SOL_CAN_RAW, CAN_RAW_FILTER, filters_.data(), filter_bytes) == 0 &&
           ::bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  }

  /// Queries the state of the link. `lost`: a call has failed because of the link.
  void follow_link(bool lost = false) {
    int error = 0;
    socklen_t size = sizeof error;
    getsockopt(socket_, SOL_SOCKET, SO_ERROR, &error,
               &size);  // reading clears it; done before look_up, or a loss in between would be missed
    lost = lost || error == ENETDOWN || error == ENODEV;
    const Interface now = look_up(socket_, name_);
    const bool bound = now.index != 0 && (now.index == bound_index() || bind(now.index));
    const Link link = bound ? now.link : Link::gone;
    if (link_ == Link::up && (lost || link != Link::up)) ++counters_.link_losses;
    link_ = link;
  }

  Sent send(const Frame& frame) override {
    const auto raw = to_kernel(frame);
    if (!raw || listen_only_ || (frame.fd && !fd_)) return refused();
    if (link_ != Link::up && link_changed()) follow_link();
    for (int attempt = 0; link_ == Link::up && attempt < 2; ++attempt) {  // twice, because of the stale error
      if (::send(socket_, &*raw, frame.fd ? CANFD_MTU : CAN_MTU, MSG_DONTWAIT) >= 0) {
        ++counters_.sent;
        return Sent::done;
      }
      if (errno == ENOBUFS || errno == EAGAIN) {
        ++counters_.send_busy;
        return Sent::busy;
      }
      if (errno != ENETDOWN && errno != ENXIO && errno != ENODEV) return refused();  // EINVAL: FD on a classic bus
      follow_link(true);
    }
    ++counters_.send_down;
    return Sent::down;
  }

  bool receive(Frame& frame) override {
    for (;;) {
      canfd_frame raw{};
      alignas(cmsghdr) char control[CMSG_SPACE(sizeof(timespec)) + CMSG_SPACE(sizeof(std::uint32_t))];
      iovec data{&raw, sizeof raw};
      msghdr message{};
      message.msg_iov = &data;
      message.msg_iovlen = 1;
      message.msg_control = control;
      message.msg_controllen = sizeof control;
      const ssize_t size = recvmsg(socket_, &message, MSG_DONTWAIT);
      if (size < 0 && (errno == ENETDOWN || errno == ENODEV)) {
        follow_link(true);
        continue;  // frames may be waiting behind the error
      }
      if (size < 0) {
        if (link_changed()) follow_link();
        return false;
      }
      const std::int64_t time_ns = take_control(message);
      const bool fd = size == CANFD_MTU;
      if ((size != CAN_MTU && !fd) || !valid_size(fd, raw.len)) {
        ++counters_.malformed;
        continue;
      }
      frame = from_kernel(raw, fd);
      frame.time_ns = time_ns;
      if (frame.error) {
        ++counters_.error_frames;
        if (frame.id & CAN_ERR_BUSOFF) ++counters_.bus_off;
      } else {
        ++counters_.received;
      }
      return true;
    }
  }

  /// Returns also when a link changed.
  void wait(std::int64_t deadline_ns) override {
    const std::int64_t now_ns = clock_ns();
    const std::int64_t left_ns =
        deadline_ns > now_ns ? deadline_ns - now_ns : 0;  // no overflow for the minimum deadline
    const timespec timeout{left_ns / second_ns, left_ns % second_ns};
    pollfd events[] = {{socket_, POLLIN, 0}, {watch_, POLLIN, 0}};
    if (ppoll(events, 2, &timeout, nullptr) <= 0) return;
    const bool changed = events[1].revents != 0 && link_changed();
    if (changed || events[0].revents & POLLERR) follow_link();
  }

  std::int64_t watch(std::vector<pollfd>& polled, std::int64_t deadline_ns) override {
    polled.push_back({socket_, POLLIN, 0});
    polled.push_back({watch_, POLLIN, 0});
    return deadline_ns;
  }

  /// As of the last send, receive or wait.
  bool up() const override { return link_ == Link::up; }

  std::optional<double> bit_rate() const override { return bit_rate_of(name_); }

  std::string state() const override {
    switch (link_) {
      case Link::up:
        return fmt::format("interface {} is up", name_);
      case Link::no_carrier:
        return fmt::format("interface {} has no carrier (bus-off, or its peer is down)", name_);
      case Link::down:
        return fmt::format("interface {} is down", name_);
      case Link::gone:
        break;
    }
    return fmt::format("interface {} is gone", name_);
  }

 private:
  int bound_index() const {
    sockaddr_can address{};
    socklen_t size = sizeof address;
    return getsockname(socket_, reinterpret_cast<sockaddr*>(&address), &size) == 0 ? address.can_ifindex : 0;
  }

  /// Whether any link of this machine changed since the last call.
  bool link_changed() {
    bool changed = false;
    char message;  // its first byte; the content is not used
    while (recv(watch_, &message, 1, MSG_DONTWAIT) >= 0 || errno == ENOBUFS)
      changed = true;  // ENOBUFS: more changes than the socket could hold
    return changed;
  }

  /// Time of reception, CLOCK_REALTIME; counts lost frames, which the kernel reports with the first frame after them.
  std::int64_t take_control(msghdr& message) {
    std::int64_t time_ns = 0;
    for (auto* part = CMSG_FIRSTHDR(&message); part; part = CMSG_NXTHDR(&message, part)) {
      if (part->cmsg_level != SOL_SOCKET) continue;
      if (part->cmsg_type == SCM_TIMESTAMPNS) {
        timespec time;
        std::memcpy(&time, CMSG_DATA(part), sizeof time);
        time_ns = time.tv_sec * second_ns + time.tv_nsec;
      } else if (part->cmsg_type == SO_RXQ_OVFL) {
        std::uint32_t lost;  // since the socket was opened, modulo 2^32
        std::memcpy(&lost, CMSG_DATA(part), sizeof lost);
        counters_.receive_lost += lost - std::exchange(lost_, lost);
      }
    }
    return time_ns;
  }

  Sent refused() {
    ++counters_.send_refused;
    return Sent::refused;
  }

  Descriptor socket_, watch_;
  std::vector<can_filter> filters_;
  bool fd_, listen_only_;
  Link link_ = Link::gone;
  std::uint32_t lost_ = 0;
};

}  // namespace

Result<std::unique_ptr<Transport>> open_socketcan(const std::string& interface, const OpenOptions& options) {
  const auto fail = [&](std::string message) { return tl::unexpected(Error(std::move(message))); };

  Descriptor socket(::socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW));
  if (socket < 0) {
    const int error = errno;
    if (error == EAFNOSUPPORT || error == EPROTONOSUPPORT)
      return fail(
          fmt::format("{}: this kernel has no SocketCAN; try `modprobe can_raw`, or serve the bus over TCP as "
                      "socketcand://127.0.0.1:29536/{}",
                      interface, interface));
    if (error == EPERM || error == EACCES)
      return fail(fmt::format(
          "{}: no permission to open CAN sockets; allow them in the container's or service's settings", interface));
    return fail(fmt::format("{}: no CAN socket ({})", interface, reason(error)));
  }

  const Interface found = look_up(socket, interface);
  if (found.index == 0) return fail(fmt::format("no interface \"{}\"; {}", interface, can_interfaces(socket)));
  if (!found.can) return fail(fmt::format("{} is no CAN interface; {}", interface, can_interfaces(socket)));
  if (found.link == Link::down)
    return fail(fmt::format(
        "interface {} is down; `ip link set {} up` brings it up, hardware with `type can bitrate BIT_PER_S` behind",
        interface, interface));
  for (const std::uint32_t id : options.identifiers)
    if (id > CAN_SFF_MASK) return fail(fmt::format("{}: {:X} is no 11-bit identifier", interface, id));
  if (options.identifiers.size() > CAN_RAW_FILTER_MAX)
    return fail(fmt::format("{}: {} identifiers to receive; the kernel filters {} at most, leave them empty for all",
                            interface, options.identifiers.size(), CAN_RAW_FILTER_MAX));

  Descriptor watch(::socket(AF_NETLINK, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, NETLINK_ROUTE));
  sockaddr_nl links{};
  links.nl_family = AF_NETLINK;
  links.nl_groups = RTMGRP_LINK;
  if (watch < 0 || ::bind(watch, reinterpret_cast<const sockaddr*>(&links), sizeof links) != 0)
    return fail(fmt::format("{}: cannot watch its link through NETLINK_ROUTE ({})", interface, reason(errno)));

  const can_err_mask_t errors = CAN_ERR_MASK;
  const int on = 1;
  if (!set_option(socket, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, errors) ||
      !set_option(socket, SOL_SOCKET, SO_TIMESTAMPNS, on) || !set_option(socket, SOL_SOCKET, SO_RXQ_OVFL, on) ||
      (options.fd && !set_option(socket, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, on)))
    return fail(fmt::format("{}: the kernel refuses a socket option ({})", interface, reason(errno)));
  // Only root may exceed net.core.rmem_max; a smaller buffer works too, and losses are counted.
  if (!set_option(socket, SOL_SOCKET, SO_RCVBUFFORCE, receive_buffer_bytes))
    set_option(socket, SOL_SOCKET, SO_RCVBUF, receive_buffer_bytes);

  auto transport = std::make_unique<SocketCan>(interface, options, std::move(socket), std::move(watch));
  if (!transport->bind(found.index)) return fail(fmt::format("{}: cannot bind to it ({})", interface, reason(errno)));
  transport->follow_link();
  return transport;
}

}  // namespace tribotwin::hil
