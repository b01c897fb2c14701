#pragma once

#include <boost/asio/ip/tcp.hpp>

#include <tribotwin/twin/live/hub.hpp>

namespace tribotwin::twin::live {

/// Answers the one request of a connection, or makes it a viewer.
void serve(Hub& hub, boost::asio::ip::tcp::socket socket);

}  // namespace tribotwin::twin::live
