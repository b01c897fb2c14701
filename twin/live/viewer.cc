#include <algorithm>
#include <bit>
#include <cstring>

#include <boost/asio/buffer.hpp>

#include <tribotwin/twin/live/protocol/geometry.hpp>
#include <tribotwin/twin/live/viewer.hpp>

namespace tribotwin::twin::live {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace websocket = boost::beast::websocket;
using beast::error_code;

Viewer::Viewer(Hub& hub, Place place, Stream stream, std::string_view protocol)
    : hub_(hub),
      protocol_(protocol),
      place_(std::move(place)),
      socket_(std::move(stream)),
      number_(++hub.viewers_so_far) {}

void Viewer::start(Request request) {
  const Limits& limits = hub_.options.limits;
  request_ = std::move(request);
  beast::get_lowest_layer(socket_).expires_never();  // the WebSocket has time limits of its own
  socket_.set_option(websocket::stream_base::timeout{
      .handshake_timeout = limits.header, .idle_timeout = limits.response, .keep_alive_pings = true});
  socket_.set_option(websocket::stream_base::decorator([this](websocket::response_type& response) {
    response.set(beast::http::field::server, "tribotwin");
    response.set(beast::http::field::sec_websocket_protocol, protocol_);
  }));
  socket_.read_message_max(limits.message_bytes);
  socket_.auto_fragment(false);
  socket_.control_callback([this](websocket::frame_type, beast::string_view) {
    if (!too_fast()) return;
    asio::post(socket_.get_executor(), [self = shared_from_this()] {  // not within the read that has heard it
      self->close(CloseCode::policy_error, "too many messages");
    });
  });
  hub_.viewers.push_back(shared_from_this());
  socket_.async_accept(request_, [self = shared_from_this()](error_code error) {
    if (error) return self->drop();
    self->open_ = true;
    self->read();
    self->send();
  });
  greet();
}

void Viewer::greet() {
  texts_.push_back(hub_.hello_text);
  for (const Told& event : hub_.events) texts_.push_back(event.text);
  status_ = hub_.status.text;
  poses_ = hub_.poses;
}

void Viewer::drop() {
  error_code ignored;
  beast::get_lowest_layer(socket_).socket().close(ignored);
  std::erase_if(hub_.viewers, [this](const auto& viewer) { return viewer.get() == this; });
}

void Viewer::close(CloseCode code, const char* reason) {
  if (!open_) return drop();
  if (std::exchange(closing_, true)) return;
  socket_.async_close({code, reason}, [self = shared_from_this()](error_code) { self->drop(); });
}

void Viewer::read() {
  socket_.async_read(heard_, [self = shared_from_this()](error_code error, std::size_t) { self->heard(error); });
}

void Viewer::heard(error_code error) {
  if (error) return closing_ ? void() : drop();
  if (closing_) return;
  if (too_fast()) return close(CloseCode::policy_error, "too many messages");
  if (socket_.got_text())
    obey(beast::buffers_to_string(heard_.data()));
  else if (!obey_binary())
    return close(CloseCode::unknown_data, "only text is understood");
  heard_.consume(heard_.size());
  read();
}

bool Viewer::too_fast() {
  const auto now = std::chrono::steady_clock::now();
  if (now - second_ >= std::chrono::seconds(1)) second_ = now, messages_ = 0;
  return ++messages_ > messages_per_s();
}

void Viewer::obey(const std::string& text) {
  Asking asking = read_message(text, hub_.hello, hub_.options.readonly);
  if (asking.watched) {
    watched_ = asking.watched;
    return;
  }
  if (asking.command) {
    asking.command->viewer = number_;
    if (hub_.files && RowFiles::obeys(asking.command->name)) return hub_.files->obey(*asking.command);
    if (hub_.commands.push(std::move(*asking.command))) return;
    asking.refusal.ok = false;
    asking.refusal.text = "too many commands wait";
  }
  tell(std::make_shared<const std::string>(to_json(asking.refusal)));
}

void Viewer::tell(Text text) {
  if (texts_.size() >= hub_.options.limits.texts + hub_.options.limits.events)
    return asio::post(socket_.get_executor(), [self = shared_from_this()] { self->drop(); });  // who tells, iterates
  texts_.push_back(std::move(text));
  send();
}

void Viewer::add_row(std::uint64_t number, std::span<const double> row) {
  const bool follows = number == first_row_ + row_count_;
  if (!follows || (rows_.size() + row.size()) * sizeof(double) > hub_.options.limits.row_bytes)
    lost_ = lost_ || row_count_ > 0, rows_.clear(), row_count_ = 0;
  if (row_count_ == 0) first_row_ = number;
  rows_.insert(rows_.end(), row.begin(), row.end());
  ++row_count_;
}

void Viewer::send_rows() {
  rows_due_ = true;
  send();
}

Text pose_message(std::uint64_t row, std::span<const float> poses) {
  static_assert(std::endian::native == std::endian::little);
  const std::uint32_t head[] = {2, static_cast<std::uint32_t>(poses.size() / pose_numbers)};
  std::string message(sizeof head + sizeof row + poses.size_bytes(), '\0');
  std::memcpy(message.data(), head, sizeof head);
  std::memcpy(message.data() + sizeof head, &row, sizeof row);
  std::memcpy(message.data() + sizeof head + sizeof row, poses.data(), poses.size_bytes());
  return std::make_shared<const std::string>(std::move(message));
}

/// Header and rows as twin/live/protocol/README.md says.
void Viewer::make_batch() {
  static_assert(std::endian::native == std::endian::little);
  const auto rows = static_cast<std::uint32_t>(row_count_);
  const std::uint32_t head[] = {1, rows, static_cast<std::uint32_t>(rows_.size() / row_count_), 0};
  batch_.resize(sizeof head + sizeof first_row_ + rows_.size() * sizeof(double));
  std::memcpy(batch_.data(), head, sizeof head);
  std::memcpy(batch_.data() + sizeof head, &first_row_, sizeof first_row_);
  std::memcpy(batch_.data() + sizeof head + sizeof first_row_, rows_.data(), rows_.size() * sizeof(double));
  rows_.clear();
  row_count_ = 0;
}

void Viewer::send() {
  if (open_ && !writing_ && !closing_) send_next();
}

void Viewer::send_next() {
  if (!texts_.empty()) {
    sent_ = std::move(texts_.front());
    texts_.pop_front();
    return write(true, asio::buffer(*sent_));
  }
  if (Text& next = status_ ? status_ : law_) {
    sent_ = std::exchange(next, nullptr);
    return write(true, asio::buffer(*sent_));
  }
  if (rows_due_ && row_count_ > 0) {
    rows_due_ = false;
    make_batch();
    return write(false, asio::buffer(batch_));
  }
  if (!poses_) return;
  sent_ = std::exchange(poses_, nullptr);
  write(false, asio::buffer(*sent_));
}

void Viewer::write(bool text, asio::const_buffer what) {
  writing_ = true;
  socket_.text(text);
  socket_.async_write(what, [self = shared_from_this()](error_code error, std::size_t) {
    self->writing_ = false;
    if (error) return self->closing_ ? void() : self->drop();
    self->send();
  });
}

}  // namespace tribotwin::twin::live
