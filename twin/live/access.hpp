#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include <tribotwin/plugins/friction/error.hpp>

/// Who may see a live bench: addresses, the token, and the names under which a browser may ask.
namespace tribotwin::twin::live {

/// Where a server listens.
struct Address {
  std::string host = "127.0.0.1";  ///< of IPv4 or IPv6, without brackets
  std::uint16_t port = 8080;       ///< 0: any that is free
  bool loopback = true;
};

/// ADDRESS:PORT with a numeric address, [ADDRESS]:PORT for IPv6, or localhost:PORT. Fails with what would be right.
Result<Address> read_address(std::string_view text);

/// "127.0.0.1:8080", "[::1]:8080": as in an URL and in the header field Host.
std::string authority(std::string_view host, std::uint16_t port);

/// 128 random bits of the kernel as 32 hexadecimal digits. Fails where the kernel has none.
Result<std::string> new_token();

/// Takes the same time wherever the two differ. Their lengths are no secret.
bool equal_in_constant_time(std::string_view a, std::string_view b);

/// The fields of a request on which access depends; empty: not there.
struct Asked {
  std::string_view target, host, origin, cookie;
};

/// Rules of one connection.
struct Access {
  std::string token;    ///< empty: none is needed
  std::string address;  ///< of our end of the connection
  std::uint16_t port;
  bool loopback;  ///< of that address
  /// An Origin besides our own that may make this request; empty: none.
  std::string_view origin = {};

  /// Why the request is refused; nullptr: it is not.
  const char* refusal(const Asked& asked) const;
  /// Sets the cookie that stands for the token from then on; empty where none is needed.
  std::string set_cookie() const;

 private:
  bool is_our_name(std::string_view authority) const;
  bool has_token(const Asked& asked) const;
  std::string cookie_name() const;
};

/// Whether it can be an Origin: scheme://host or scheme://host:port as browsers send it, or "file://". Not "null",
/// which any site can make its own with a sandboxed frame, and not "*".
bool is_origin(std::string_view text);

/// The part of a target before '?'.
std::string_view path_of(std::string_view target);

}  // namespace tribotwin::twin::live
