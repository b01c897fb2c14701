#define MOMENTS moments_avx2
#define RESIDUALS residuals_avx2
#include "moments_kernel.inc"
