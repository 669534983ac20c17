// Marks per-item math that compiles for the host and, under nvcc, for the device.
#pragma once

#ifdef __CUDACC__
#define NACRE_HD __host__ __device__
#else
#define NACRE_HD
#endif
