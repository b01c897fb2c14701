#define MOMENTS moments_avx512
#define RESIDUALS residuals_avx512
#include "moments_kernel.inc"
