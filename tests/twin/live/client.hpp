#pragma once

#include <cstdint>
#include <cstring>
#include <optional>
#include <string>
#include <vector>

#include <arpa/inet.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <tribotwin/twin/live/server.hpp>

/// The other end of a live bench in tests: bytes over loopback, written without the library that the server uses.
namespace tribotwin::twin::live {

inline std::uint16_t port_of(const Server& server) {
  const std::string& url = server.url();
  return static_cast<std::uint16_t>(std::stoi(url.substr(url.rfind(':') + 1)));
}

class Client {
 public:
  explicit Client(std::uint16_t port, int receive_bytes = 0) : port_(port), socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    if (receive_bytes) ::setsockopt(socket_, SOL_SOCKET, SO_RCVBUF, &receive_bytes, sizeof receive_bytes);
    const timeval patience{.tv_sec = 20, .tv_usec = 0};
    ::setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    sockaddr_in address{.sin_family = AF_INET, .sin_port = htons(port), .sin_addr = {htonl(INADDR_LOOPBACK)}};
    if (::connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) ADD_FAILURE() << "no server";
  }
  Client(const Client&) = delete;
  ~Client() { ::close(socket_); }

  bool send(std::string_view bytes) {
    return ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(bytes.size());
  }
  /// How many of the bytes there is room for now.
  std::size_t send_now(std::string_view bytes) {
    const ssize_t sent = ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    return sent > 0 ? static_cast<std::size_t>(sent) : 0;
  }
  void say_no_more() { ::shutdown(socket_, SHUT_WR); }
  /// Whether the server has closed the connection; waits for a byte or that.
  bool closed() {
    char byte;
    const ssize_t got = ::recv(socket_, &byte, 1, 0);
    return got == 0 || (got < 0 && errno == ECONNRESET);
  }
  /// Whether it has done so by now.
  bool closed_now() {
    char byte;
    const ssize_t got = ::recv(socket_, &byte, 1, MSG_DONTWAIT);
    return got == 0 || (got < 0 && errno != EAGAIN);
  }
  /// Reads what is there; true where there is nothing more now.
  bool rest_now() {
    char bytes[65536];
    while (::recv(socket_, bytes, sizeof bytes, MSG_DONTWAIT) > 0) continue;
    return true;
  }
  std::string rest() {
    std::string all;
    char bytes[4096];
    for (ssize_t got; (got = ::recv(socket_, bytes, sizeof bytes, 0)) > 0;) all.append(bytes, static_cast<size_t>(got));
    return all;
  }

  /// The answer to GET with these further lines; Host is ours unless they have one.
  std::string get(const std::string& target, const std::string& more = {}) {
    const std::string host = more.find("Host:") == more.npos ? fmt::format("Host: 127.0.0.1:{}\r\n", port_) : "";
    send(fmt::format("GET {} HTTP/1.1\r\n{}{}\r\n", target, host, more));
    return rest();
  }

  static constexpr const char* upgrade =
      "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: "
      "AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Protocol: tribotwin.live.v1\r\n";
  /// Becomes a viewer; false where it is refused.
  bool watch(const std::string& more = {}) {
    send(fmt::format("GET /live HTTP/1.1\r\nHost: 127.0.0.1:{}\r\n{}{}\r\n", port_, upgrade, more));
    std::string head;
    for (char byte; !head.ends_with("\r\n\r\n") && ::recv(socket_, &byte, 1, 0) == 1;) head += byte;
    return head.starts_with("HTTP/1.1 101");
  }
  /// The head of the answer to a request for a WebSocket with these subprotocols.
  std::string ask_for(const std::string& protocols, const std::string& more = {}, const std::string& target = "/") {
    send(
        fmt::format("GET {} HTTP/1.1\r\nHost: 127.0.0.1:{}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                    "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n"
                    "Sec-WebSocket-Protocol: {}\r\n{}\r\n",
                    target, port_, protocols, more));
    std::string head;
    for (char byte; !head.ends_with("\r\n\r\n") && ::recv(socket_, &byte, 1, 0) == 1;) head += byte;
    return head;
  }
  /// A message as a browser sends it.
  bool say(const std::string& text, int opcode = 1) {
    std::string frame{static_cast<char>(0x80 | opcode)};
    if (text.size() < 126) {
      frame += static_cast<char>(0x80 | text.size());
    } else {
      frame += static_cast<char>(0x80 | 126);
      frame += static_cast<char>(text.size() >> 8);
      frame += static_cast<char>(text.size() & 0xFF);
    }
    return send(frame + std::string(4, '\0') + text);  // a mask of zeros
  }
  struct Message {
    int opcode;  ///< 1 text, 2 rows, 8 the end
    std::string content;
  };
  std::optional<Message> hear() {
    unsigned char head[2];
    if (!read(head, 2)) return std::nullopt;
    std::uint64_t size = head[1] & 0x7F;
    unsigned char bytes[8];
    const int more = size == 126 ? 2 : size == 127 ? 8 : 0;
    if (more && !read(bytes, static_cast<std::size_t>(more))) return std::nullopt;
    for (int i = 0; i < more; ++i) size = (i ? size << 8 : 0) | bytes[i];
    Message message{head[0] & 0x0F, std::string(size, '\0')};
    if (!read(message.content.data(), size)) return std::nullopt;
    return message;
  }
  /// The next text with this type, beyond all else.
  std::string hear_text(const std::string& type) {
    while (const auto message = hear())
      if (message->opcode == 1 && message->content.starts_with(fmt::format(R"({{"type":"{}")", type)))
        return message->content;
    return {};
  }
  /// Code of the close frame; 0: the connection ended without one.
  int hear_end() {
    while (const auto message = hear())
      if (message->opcode == 8 && message->content.size() >= 2)
        return static_cast<unsigned char>(message->content[0]) << 8 | static_cast<unsigned char>(message->content[1]);
    return 0;
  }

 private:
  bool read(void* into, std::size_t size) {
    return size == 0 || ::recv(socket_, into, size, MSG_WAITALL) == static_cast<ssize_t>(size);
  }
  std::uint16_t port_;
  int socket_;
};

/// The rows of a binary message.
struct Batch {
  std::uint32_t kind, rows, columns, zero;
  std::uint64_t first;
  std::vector<double> values;

  explicit Batch(const std::string& message) {
    std::uint32_t head[4];
    std::memcpy(head, message.data(), sizeof head);
    std::memcpy(&first, message.data() + sizeof head, sizeof first);
    kind = head[0], rows = head[1], columns = head[2], zero = head[3];
    constexpr std::size_t begin = sizeof head + sizeof first;
    values.resize((message.size() - begin) / sizeof(double));
    std::memcpy(values.data(), message.data() + begin, values.size() * sizeof(double));
  }
};

}  // namespace tribotwin::twin::live
