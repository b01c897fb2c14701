// Prints the reference part of plugins/README.md; the test compares, `> plugins/README.md` renews.
#include <cstdio>
#include <tribotwin/plugins/drive/configuration.hpp>
int main() { std::fputs(tribotwin::drive::reference_markdown().c_str(), stdout); }
