#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>

#include <tribotwin/twin/live/connection.hpp>
#include <tribotwin/twin/live/foxglove_viewer.hpp>
#include <tribotwin/twin/live/page.hpp>
#include <tribotwin/twin/live/viewer.hpp>

namespace tribotwin::twin::live {
namespace {

namespace beast = boost::beast;
namespace http = boost::beast::http;
using beast::error_code;
using boost::asio::ip::tcp;

constexpr const char* content_policy =
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

std::string_view text_of(beast::string_view text) { return {text.data(), text.size()}; }
beast::string_view to_beast(std::string_view text) { return {text.data(), text.size()}; }

class Connection : public std::enable_shared_from_this<Connection> {
 public:
  Connection(Hub& hub, tcp::socket socket) : hub_(hub), place_(hub), stream_(std::move(socket)) {
    parser_.header_limit(static_cast<std::uint32_t>(hub.options.limits.header_bytes));
    parser_.body_limit(0);
    error_code ignored;
    stream_.socket().set_option(tcp::no_delay(true), ignored);  // a batch waits for no answer to the one before
    stream_.rate_policy().read_limit(hub.options.limits.bytes_per_s);
  }

  void start() {
    stream_.expires_after(hub_.options.limits.header);
    http::async_read(stream_, buffer_, parser_, [self = shared_from_this()](error_code error, std::size_t) {
      if (!error) return self->answer();
      const bool wrong = error.category() == http::make_error_code(http::error::bad_method).category();
      if (wrong && error != http::error::end_of_stream && error != http::error::partial_message)
        self->refuse(http::status::bad_request, "This is no request that the live bench understands");
    });
  }

 private:
  std::string_view field(http::field name) { return text_of(parser_.get()[name]); }

  std::optional<Access> access() {
    error_code error;
    const auto end = stream_.socket().local_endpoint(error);
    if (error) return std::nullopt;
    return Access{hub_.token, end.address().to_string(), end.port(), end.address().is_loopback(),
                  foxglove_protocol().empty() ? std::string_view{} : hub_.options.foxglove_origin};
  }

  void answer() {
    const auto rules = access();
    if (!rules) return;  // the other end is gone
    const auto& request = parser_.get();
    const Asked asked{text_of(request.target()), field(http::field::host), field(http::field::origin),
                      field(http::field::cookie)};
    if (request.count(http::field::host) != 1) return refuse(http::status::bad_request, "There must be one Host");
    if (const char* why = rules->refusal(asked)) return refuse(http::status::forbidden, why);
    const bool get = request.method() == http::verb::get;
    if (!get && request.method() != http::verb::head)
      return refuse(http::status::method_not_allowed, "Only GET and HEAD are understood");
    const auto path = path_of(asked.target);
    if (const auto protocol = foxglove_protocol(); (path == "/live" || path == "/") && get && !protocol.empty())
      return become_viewer<FoxgloveViewer>(protocol);
    if (path == "/live" && get) return become_page();
    if (path == "/geometry.json" && !hub_.hello.geometry.empty())
      return send(http::status::ok, "application/json", hub_.hello.geometry, rules->set_cookie());
    const PageFile* file = page_file(path);
    if (!file) return refuse(http::status::not_found, "There is no such file");
    send(http::status::ok, file->type, file->content, rules->set_cookie());
  }

  /// That of Foxglove's names which a request for a WebSocket likes best; empty where it is none or offers ours.
  std::string_view foxglove_protocol() {
    if (!beast::websocket::is_upgrade(parser_.get())) return {};
    http::token_list offered(parser_.get()[http::field::sec_websocket_protocol]);
    if (offered.exists(subprotocol)) return {};
    for (const auto& name : offered)
      for (const std::string_view known : foxglove::subprotocols)
        if (text_of(name) == known) return known;
    return {};
  }

  void become_page() {
    if (!beast::websocket::is_upgrade(parser_.get()))
      return refuse(http::status::upgrade_required, "This is a WebSocket");
    if (!http::token_list(parser_.get()[http::field::sec_websocket_protocol]).exists(subprotocol))
      return refuse(http::status::bad_request, "The subprotocol must be tribotwin.live.v1, or one of Foxglove's");
    become_viewer<Viewer>(subprotocol);
  }

  template <class Kind>
  void become_viewer(std::string_view protocol) {
    if (hub_.viewers.size() >= hub_.options.limits.viewers)
      return refuse(http::status::service_unavailable, "Too many pages are open");
    std::make_shared<Kind>(hub_, std::move(place_), std::move(stream_), protocol)->start(parser_.release());
  }

  void refuse(http::status status, std::string_view why) {
    refusal_ = std::string(why) + ".\n";
    send(status, "text/plain; charset=utf-8", refusal_, {});
  }

  /// `content` must stay: it is not copied.
  void send(http::status status, std::string_view type, std::string_view content, const std::string& cookie) {
    response_.result(status);
    response_.version(11);
    response_.keep_alive(false);
    response_.set(http::field::server, "tribotwin");
    response_.set(http::field::content_type, to_beast(type));
    response_.set(http::field::content_length, std::to_string(content.size()));
    response_.set(http::field::cache_control, "no-store");
    response_.set("Content-Security-Policy", content_policy);
    response_.set("X-Content-Type-Options", "nosniff");
    response_.set("Referrer-Policy", "no-referrer");
    response_.set("Cross-Origin-Resource-Policy", "same-origin");
    if (!cookie.empty()) response_.set(http::field::set_cookie, cookie);
    if (status == http::status::method_not_allowed) response_.set(http::field::allow, "GET, HEAD");
    if (parser_.get().method() != http::verb::head) response_.body() = {content.data(), content.size()};
    stream_.expires_after(hub_.options.limits.response);
    http::async_write(stream_, response_, [self = shared_from_this()](error_code, std::size_t) {
      error_code ignored;
      self->stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
    });
  }

  Hub& hub_;
  Place place_;
  Stream stream_;
  beast::flat_buffer buffer_{16384};
  http::request_parser<http::empty_body> parser_;
  http::response<http::span_body<const char>> response_;
  std::string refusal_;
};

}  // namespace

void serve(Hub& hub, tcp::socket socket) { std::make_shared<Connection>(hub, std::move(socket))->start(); }

}  // namespace tribotwin::twin::live
