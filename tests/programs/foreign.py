"""What a user never has to read."""
import re

# Words of libraries, of the C++ runtime and the kernel, of a program that did not expect what it met. Every line of
# ours begins with a file, an option or "note:".
FOREIGN = re.compile(
    r"HDF5-DIAG|H5[A-Z]\w*\(|terminate called|what\(\)|yaml-cpp|json\.exception|\[json|nlohmann|[cC]eres|glog|"
    r"WARNING: Logging|Check failed|std::|bad_alloc|Sanitizer|Segmentation|Abort|core dumped|free\(\)|malloc|"
    r"corruption|Traceback|bad conversion|mju_|mj_|\bmatio|InvalidNode|\.cc:\d|\.cpp:\d|basic_|Assertion|GLib|CRITICAL"
)
