#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>

#include <arpa/inet.h>
#include <fmt/format.h>
#include <sys/random.h>

#include <tribotwin/twin/live/access.hpp>

namespace tribotwin::twin::live {
namespace {

/// Whether it is an IPv4 or IPv6 address, and one of this machine alone.
struct Numeric {
  bool valid, loopback;
};
Numeric numeric(const std::string& host) {
  in_addr four{};
  if (::inet_pton(AF_INET, host.c_str(), &four) == 1) return {true, (ntohl(four.s_addr) >> 24) == 127};
  in6_addr six{};
  if (::inet_pton(AF_INET6, host.c_str(), &six) == 1) return {true, IN6_IS_ADDR_LOOPBACK(&six) != 0};
  return {false, false};
}

/// Calls `take` for the parts of a list until it returns true; whether it did.
template <class Take>
bool any_of_list(std::string_view list, char separator, Take take) {
  while (!list.empty()) {
    const auto end = std::min(list.find(separator), list.size());
    if (take(list.substr(0, end))) return true;
    list.remove_prefix(std::min(end + 1, list.size()));
  }
  return false;
}

bool same_name(std::string_view a, std::string_view b) {
  const auto lower = [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; };
  return std::ranges::equal(a, b, {}, lower, lower);
}

/// What follows `prefix`, if it is there.
std::string_view after(std::string_view text, std::string_view prefix) {
  return text.starts_with(prefix) ? text.substr(prefix.size()) : std::string_view{};
}

}  // namespace

Result<Address> read_address(std::string_view text) {
  const auto wrong = [&](std::string_view why) {
    return tl::unexpected(
        Error(fmt::format("'{}': {}; for example 127.0.0.1:8080, [::1]:8080 or 0.0.0.0:0 "
                          "(0 chooses a port)",
                          text, why)));
  };
  const auto colon = text.rfind(':');
  if (colon == text.npos) return wrong("has no port");
  const std::string_view digits = text.substr(colon + 1);
  Address address;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), address.port);
  if (error != std::errc{} || end != digits.data() + digits.size()) return wrong("the port must be 0 to 65535");
  std::string_view host = text.substr(0, colon);
  const bool brackets = host.size() > 2 && host.front() == '[' && host.back() == ']';
  if (brackets) host = host.substr(1, host.size() - 2);
  if ((host.find(':') != host.npos) != brackets) return wrong("an IPv6 address has brackets, and no other one");
  address.host = same_name(host, "localhost") ? "127.0.0.1" : std::string(host);
  const Numeric kind = numeric(address.host);
  if (!kind.valid) return wrong("the address must be a numeric one of this machine");
  address.loopback = kind.loopback;
  return address;
}

std::string authority(std::string_view host, std::uint16_t port) {
  return host.find(':') == host.npos ? fmt::format("{}:{}", host, port) : fmt::format("[{}]:{}", host, port);
}

Result<std::string> new_token() {
  std::array<unsigned char, 16> bytes;
  if (::getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size()))
    return work_failed(fmt::format("no random numbers for a token: {}", std::strerror(errno)));
  std::string token;
  for (const unsigned char byte : bytes) token += fmt::format("{:02x}", byte);
  return token;
}

bool equal_in_constant_time(std::string_view a, std::string_view b) {
  if (a.size() != b.size()) return false;
  volatile unsigned char differs = 0;  // volatile: no compiler may end the loop early
  for (std::size_t i = 0; i < a.size(); ++i)
    differs =
        static_cast<unsigned char>(differs | (static_cast<unsigned char>(a[i]) ^ static_cast<unsigned char>(b[i])));
  return differs == 0;
}

bool is_origin(std::string_view text) {
  if (text == "file://") return true;
  const auto colon = text.find("://");
  if (colon == text.npos || colon == 0) return false;
  const auto is_letter = [](char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); };
  const auto in_host = [&](char c) {
    return is_letter(c) || (c >= '0' && c <= '9') || std::string_view(".-_:[]").find(c) != std::string_view::npos;
  };
  const std::string_view host = text.substr(colon + 3);
  return std::ranges::all_of(text.substr(0, colon), is_letter) && !host.empty() && std::ranges::all_of(host, in_host);
}

std::string_view path_of(std::string_view target) { return target.substr(0, target.find('?')); }

std::string Access::cookie_name() const { return fmt::format("tribotwin_{}", port); }

std::string Access::set_cookie() const {
  if (token.empty()) return {};
  return fmt::format("{}={}; Path=/; HttpOnly; SameSite=Strict", cookie_name(), token);
}

/// Other names are refused: a page of another site may have had its own name lead here (DNS rebinding).
bool Access::is_our_name(std::string_view given) const {
  const auto is = [&](std::string_view host) {
    const std::string ours = authority(host, port);
    return same_name(given, ours) || (port == 80 && same_name(given, ours.substr(0, ours.rfind(':'))));
  };
  return is(address) || (loopback && (is("localhost") || is("127.0.0.1") || is("::1")));
}

bool Access::has_token(const Asked& asked) const {
  if (token.empty()) return true;
  const std::string_view query = asked.target.substr(std::min(asked.target.find('?'), asked.target.size()));
  const auto in_query = [&](std::string_view part) { return equal_in_constant_time(after(part, "token="), token); };
  if (!query.empty() && any_of_list(query.substr(1), '&', in_query)) return true;
  const std::string name = cookie_name() + "=";
  return any_of_list(asked.cookie, ';', [&](std::string_view part) {
    while (part.starts_with(' ')) part.remove_prefix(1);
    return equal_in_constant_time(after(part, name), token);
  });
}

const char* Access::refusal(const Asked& asked) const {
  if (!is_our_name(asked.host)) return "Host is not the address of this bench; use the address of the line 'web:'";
  const bool allowed = asked.origin.empty() || (!origin.empty() && same_name(asked.origin, origin));
  if (!allowed && !is_our_name(after(asked.origin, "http://")))
    return "Origin is another site; --web-origin names one that may connect by Foxglove's protocol";
  if (!has_token(asked)) return "The token is missing or wrong; use the address of the line 'web:'";
  return nullptr;
}

}  // namespace tribotwin::twin::live
