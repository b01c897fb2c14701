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

/// A binary message of kind 2, as twin/live/protocol/README.md says.
Text pose_message(std::uint64_t row, std::span<const float> poses);

/// A page that listens. What it cannot take in time is lost to it: rows first, in whole batches.
class Viewer : public std::enable_shared_from_this<Viewer> {
 public:
  using Request = boost::beast::http::request<boost::beast::http::empty_body>;
  using CloseCode = boost::beast::websocket::close_code;

  /// `protocol`: of those that the request offers, that which it speaks.
  Viewer(Hub& hub, Place place, Stream stream, std::string_view protocol);
  virtual ~Viewer() = default;
  /// Answers the request that becomes a WebSocket, then tells what happened so far.
  void start(Request request);

  std::uint64_t number() const { return number_; }
  void tell(Text text);
  /// Takes the place of a status that was not sent yet.
  virtual void tell_status(const Told& status) { status_ = status.text, send(); }
  virtual void tell_event(const Told& event) { tell(event.text); }
  /// The joint whose law it wants to see.
  const std::optional<std::size_t>& watched() const { return watched_; }
  /// Takes the place of a law that was not sent yet.
  void tell_law(Text text) { law_ = std::move(text), send(); }
  /// Take the place of those that were not sent yet.
  virtual void tell_poses(Text poses) { poses_ = std::move(poses), send(); }
  virtual void add_row(std::uint64_t number, std::span<const double> row);
  /// The rows that wait may be sent: the rate of batches is that of these calls.
  void send_rows();
  /// Nothing waits for it.
  virtual bool idle() const { return !writing_ && texts_.empty() && !status_ && !law_ && !poses_ && row_count_ == 0; }
  void close(CloseCode code, const char* reason);

 protected:
  /// What it is told first.
  virtual void greet();
  virtual void obey(const std::string& text);
  /// False where the other end may send no binary messages.
  virtual bool obey_binary() { return false; }
  virtual int messages_per_s() const { return hub_.options.limits.messages_per_s; }
  /// Writes what comes next, if anything waits.
  virtual void send_next();
  void send();
  /// `what` must stay until it is sent.
  void write(bool text, boost::asio::const_buffer what);

  Hub& hub_;
  std::deque<Text> texts_;
  Text sent_;
  std::vector<double> rows_;
  std::size_t row_count_ = 0;
  std::vector<char> batch_;
  bool rows_due_ = false;
  bool lost_ = false;  ///< rows that it was to have

 private:
  void read();
  void heard(boost::beast::error_code error);
  void drop();
  bool too_fast();
  void make_batch();

  const std::string protocol_;
  Place place_;
  boost::beast::websocket::stream<Stream> socket_;
  const std::uint64_t number_;
  Request request_;
  boost::beast::flat_buffer heard_;
  Text status_, law_, poses_;
  std::optional<std::size_t> watched_;
  std::uint64_t first_row_ = 0;
  bool open_ = false, writing_ = false, closing_ = false;
  std::chrono::steady_clock::time_point second_;
  int messages_ = 0;  // since `second_`
};

}  // namespace tribotwin::twin::live
