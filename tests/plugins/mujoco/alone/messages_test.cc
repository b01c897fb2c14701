// The plugin alone writes the same messages as the full build, whose libfmt it does without.
#include <string>
#include <vector>

#include <gtest/gtest.h>

std::vector<std::string> messages();
std::vector<std::string> messages_of_libfmt();

TEST(Alone, MessagesAreThoseOfLibfmt) {
  const auto ours = messages(), theirs = messages_of_libfmt();
  ASSERT_EQ(ours.size(), theirs.size());
  for (std::size_t i = 0; i < ours.size(); ++i) EXPECT_EQ(ours[i], theirs[i]);
}
