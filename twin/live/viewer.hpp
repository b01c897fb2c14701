#pragma once

#include <chrono>

#include <boost/asio/any_io_executor.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>

#include <tribotwin/twin/live/hub.hpp>

namespace tribotwin::twin::live {

/// A connection that is read no faster than Limits::bytes_per_s.
using Stream =
    boost::beast::basic_stream<boost::asio::ip::tcp, boost::asio::any_io_executor, boost::beast::simple_rate_policy>;

inline constexpr const char* subprotocol = "tribotwin.live.v1";

/// A binary message of kind 2, as twin/live/README.md says.
Text pose_message(std::uint64_t row, std::span<const float> poses);

/// A page that listens. What it cannot take in time is lost to it: rows first, in whole batches.
class Viewer : public std::enable_shared_from_this<Viewer> {
 public:
  using Request = boost::beast::http::request<boost::beast::http::empty_body>;
  using CloseCode = boost::beast::websocket::close_code;

  Viewer(Hub& hub, Place place, Stream stream);
  /// Answers the request that becomes a WebSocket, then tells what happened so far.
  void start(Request request);

  std::uint64_t number() const { return number_; }
  void tell(Text text);
  /// Takes the place of a status that was not sent yet.
  void tell_status(Text text) { status_ = std::move(text), send(); }
  /// The joint whose law it wants to see.
  const std::optional<std::size_t>& watched() const { return watched_; }
  /// Takes the place of a law that was not sent yet.
  void tell_law(Text text) { law_ = std::move(text), send(); }
  /// Take the place of those that were not sent yet.
  void tell_poses(Text poses) { poses_ = std::move(poses), send(); }
  void add_row(std::uint64_t number, std::span<const double> row);
  /// The rows that wait may be sent: the rate of batches is that of these calls.
  void send_rows();
  /// Nothing waits for it.
  bool idle() const { return !writing_ && texts_.empty() && !status_ && !law_ && !poses_ && row_count_ == 0; }
  void close(CloseCode code, const char* reason);

 private:
  void read();
  void heard(boost::beast::error_code error);
  void obey(const std::string& text);
  void send();
  void write(bool text, boost::asio::const_buffer what);
  void drop();
  bool too_fast();
  void make_batch();

  Hub& hub_;
  Place place_;
  boost::beast::websocket::stream<Stream> socket_;
  const std::uint64_t number_;
  Request request_;
  boost::beast::flat_buffer heard_;
  std::deque<Text> texts_;
  Text status_, law_, poses_, sent_;
  std::optional<std::size_t> watched_;
  std::vector<double> rows_;
  std::uint64_t first_row_ = 0;
  std::size_t row_count_ = 0;
  std::vector<char> batch_;
  bool open_ = false, writing_ = false, closing_ = false, rows_due_ = false;
  std::chrono::steady_clock::time_point second_;
  int messages_ = 0;  // since `second_`
};

}  // namespace tribotwin::twin::live
