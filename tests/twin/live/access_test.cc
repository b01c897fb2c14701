#include <set>

#include <gmock/gmock.h>

#include <tribotwin/twin/live/access.hpp>

namespace tribotwin::twin::live {
namespace {

using testing::HasSubstr;

TEST(Address, IsReadAndWhatIsWrongSaid) {
  const auto four = read_address("127.0.0.1:8080"), six = read_address("[::1]:0"), name = read_address("LocalHost:1"),
             all = read_address("0.0.0.0:65535");
  EXPECT_TRUE(four && four->host == "127.0.0.1" && four->port == 8080 && four->loopback);
  EXPECT_TRUE(six && six->host == "::1" && six->port == 0 && six->loopback);
  EXPECT_TRUE(name && name->host == "127.0.0.1" && name->loopback);
  EXPECT_TRUE(all && !all->loopback);
  for (const auto& [text, why] :
       std::vector<std::pair<const char*, const char*>>{{"", "has no port"},
                                                        {"127.0.0.1", "has no port"},
                                                        {"127.0.0.1:", "port must be 0 to 65535"},
                                                        {"127.0.0.1:65536", "port must be 0 to 65535"},
                                                        {"127.0.0.1:-1", "port must be 0 to 65535"},
                                                        {"127.0.0.1:80a", "port must be 0 to 65535"},
                                                        {"::1:80", "brackets"},
                                                        {"[127.0.0.1]:80", "brackets"},
                                                        {"example.org:80", "numeric"},
                                                        {"127.1:80", "numeric"},
                                                        {":80", "numeric"},
                                                        {"[]:80", "numeric"}}) {
    const auto read = read_address(text);
    ASSERT_FALSE(read) << text;
    EXPECT_THAT(read.error().message, HasSubstr(why)) << text;
    EXPECT_THAT(read.error().message, HasSubstr("for example 127.0.0.1:8080"));
  }
}

TEST(Token, Has128BitsAndIsNewEachTime) {
  std::set<std::string> seen;
  for (int i = 0; i < 1000; ++i) {
    const auto token = new_token();
    ASSERT_TRUE(token);
    EXPECT_EQ(token->size(), 32);
    EXPECT_EQ(token->find_first_not_of("0123456789abcdef"), std::string::npos);
    EXPECT_TRUE(seen.insert(*token).second);
  }
}

TEST(Token, EqualsOnlyItself) {
  const std::string token = "0123456789abcdef";
  EXPECT_TRUE(equal_in_constant_time(token, token));
  EXPECT_FALSE(equal_in_constant_time(token, ""));
  EXPECT_FALSE(equal_in_constant_time(token, token + "0"));
  for (std::size_t i = 0; i < token.size(); ++i)
    for (int bit = 0; bit < 8; ++bit) {
      std::string other = token;
      other[i] = static_cast<char>(other[i] ^ (1 << bit));
      EXPECT_FALSE(equal_in_constant_time(token, other));
    }
}

const Access open{"", "127.0.0.1", 8080, true};
const Access closed{"secret", "192.0.2.7", 8080, false};

TEST(Access, KnowsTheNamesOfItsAddressAlone) {
  for (const char* host : {"127.0.0.1:8080", "localhost:8080", "LOCALHOST:8080", "[::1]:8080"})
    EXPECT_EQ(open.refusal({"/", host, "", ""}), nullptr) << host;
  for (const char* host : {"", "127.0.0.1", "127.0.0.1:80", "evil.example:8080", "localhost.evil.example:8080",
                           "127.0.0.1:8080.evil.example", "192.0.2.7:8080", "localhost:8080 ", "user@localhost:8080"})
    EXPECT_THAT(open.refusal({"/", host, "", ""}), HasSubstr("Host")) << host;
  EXPECT_THAT(closed.refusal({"/?token=secret", "localhost:8080", "", ""}), HasSubstr("Host"));
  const Access at_80{"", "127.0.0.1", 80, true};
  EXPECT_EQ(at_80.refusal({"/", "localhost", "http://localhost", ""}), nullptr);
}

TEST(Access, RefusesForeignOrigins) {
  EXPECT_EQ(open.refusal({"/live", "localhost:8080", "http://localhost:8080", ""}), nullptr);
  for (const char* origin : {"null", "http://evil.example", "https://localhost:8080", "http://localhost:8081",
                             "http://localhost:8080.evil.example", "http://localhost:8080/", "localhost:8080"})
    EXPECT_THAT(open.refusal({"/live", "localhost:8080", origin, ""}), HasSubstr("Origin")) << origin;
}

TEST(Access, OneOtherOriginMayBeNamed) {
  Access named = open;
  named.origin = "http://localhost:8081";
  EXPECT_EQ(named.refusal({"/", "localhost:8080", "http://localhost:8081", ""}), nullptr);
  EXPECT_EQ(named.refusal({"/", "localhost:8080", "http://localhost:8080", ""}), nullptr);
  for (const char* origin : {"null", "http://localhost:8082", "https://localhost:8081", "http://localhost"})
    EXPECT_THAT(named.refusal({"/", "localhost:8080", origin, ""}), HasSubstr("--web-origin")) << origin;
  EXPECT_THAT(named.refusal({"/", "evil.example", "http://localhost:8081", ""}), HasSubstr("Host"));
}

TEST(Access, AnOriginIsThatOfOneSite) {
  for (const char* origin : {"http://localhost:8081", "https://app.example.org", "file://", "http://[::1]:8081"})
    EXPECT_TRUE(is_origin(origin)) << origin;
  for (const char* text : {"", "*", "null", "localhost:8081", "http://", "://a", "http://a/", "http://a/b", "http://*",
                           "http://a b", "file:///home", "http://user@a", "http://a?b", "http://a\n"})
    EXPECT_FALSE(is_origin(text)) << text;
}

TEST(Access, NeedsTheWholeTokenInQueryOrCookie) {
  const char* host = "192.0.2.7:8080";
  for (const char* target : {"/?token=secret", "/app.js?a=b&token=secret", "/?token=wrong&token=secret"})
    EXPECT_EQ(closed.refusal({target, host, "", ""}), nullptr) << target;
  for (const char* cookie : {"tribotwin_8080=secret", "a=b; tribotwin_8080=secret", "tribotwin_8080=secret; c=d"})
    EXPECT_EQ(closed.refusal({"/", host, "", cookie}), nullptr) << cookie;
  for (const char* target : {"/", "/secret", "/token=secret", "/?token=", "/?token=secre", "/?token=secrets",
                             "/?Token=secret", "/?xtoken=secret", "/?token=Secret", "?", ""})
    EXPECT_THAT(closed.refusal({target, host, "", ""}), HasSubstr("token")) << target;
  for (const char* cookie : {"tribotwin_8081=secret", "secret", "tribotwin_8080=", "tribotwin_8080=secre", ";;;"})
    EXPECT_THAT(closed.refusal({"/", host, "", cookie}), HasSubstr("token")) << cookie;
  EXPECT_THAT(closed.set_cookie(), HasSubstr("HttpOnly; SameSite=Strict"));
  EXPECT_EQ(open.set_cookie(), "");
}

}  // namespace
}  // namespace tribotwin::twin::live
