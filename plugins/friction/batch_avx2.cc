#define TRIBOTWIN_KERNEL torque_avx2
#include "batch_kernel.inc"
