#include <array>
#include <cstring>

#include <linux/can/netlink.h>
#include <linux/rtnetlink.h>
#include <net/if.h>
#include <sys/socket.h>

#include <tribotwin/hil/can/bit_rate.hpp>
#include <tribotwin/twin/io/descriptor.hpp>

namespace tribotwin::hil {
namespace {

using Bytes = std::span<const std::byte>;

/// The content of the attribute `type` in a list of attributes; empty if there is none.
Bytes attribute(Bytes list, int type) {
  while (list.size() >= sizeof(rtattr)) {
    rtattr head;
    std::memcpy(&head, list.data(), sizeof head);
    if (head.rta_len < sizeof head || head.rta_len > list.size()) return {};
    if ((head.rta_type & NLA_TYPE_MASK) == type) return list.first(head.rta_len).subspan(RTA_LENGTH(0));
    list = list.subspan(std::min<std::size_t>(RTA_ALIGN(head.rta_len), list.size()));
  }
  return {};
}

}  // namespace

std::optional<double> bit_rate_in(Bytes answer) {
  nlmsghdr head;
  constexpr std::size_t before = NLMSG_LENGTH(NLMSG_ALIGN(sizeof(ifinfomsg)));
  if (answer.size() < before) return std::nullopt;
  std::memcpy(&head, answer.data(), sizeof head);
  if (head.nlmsg_type != RTM_NEWLINK || head.nlmsg_len < before || head.nlmsg_len > answer.size()) return std::nullopt;
  const Bytes info = attribute(answer.first(head.nlmsg_len).subspan(before), IFLA_LINKINFO);
  const Bytes kind = attribute(info, IFLA_INFO_KIND);
  if (kind.size() < 3 || std::memcmp(kind.data(), "can", 3) != 0 || (kind.size() > 3 && kind[3] != std::byte{0}))
    return std::nullopt;
  const Bytes timing = attribute(attribute(info, IFLA_INFO_DATA), IFLA_CAN_BITTIMING);
  can_bittiming found;
  if (timing.size() < sizeof found) return std::nullopt;
  std::memcpy(&found, timing.data(), sizeof found);
  return found.bitrate > 0 ? std::optional<double>(found.bitrate) : std::nullopt;
}

std::optional<double> bit_rate_of(const std::string& interface) {
  const unsigned index = if_nametoindex(interface.c_str());
  const twin::Descriptor socket(::socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, NETLINK_ROUTE));
  if (index == 0 || socket.get() < 0) return std::nullopt;
  struct {
    nlmsghdr head;
    ifinfomsg link;
  } request{};
  request.head.nlmsg_len = NLMSG_LENGTH(sizeof request.link);
  request.head.nlmsg_type = RTM_GETLINK;
  request.head.nlmsg_flags = NLM_F_REQUEST;
  request.link.ifi_index = static_cast<int>(index);
  const timeval patience{.tv_sec = 1, .tv_usec = 0};
  ::setsockopt(socket.get(), SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  if (::send(socket.get(), &request, request.head.nlmsg_len, 0) < 0) return std::nullopt;
  std::array<std::byte, 32768> answer;
  const ssize_t size = ::recv(socket.get(), answer.data(), answer.size(), 0);
  return size > 0 ? bit_rate_in(std::span(answer).first(static_cast<std::size_t>(size))) : std::nullopt;
}

}  // namespace tribotwin::hil
