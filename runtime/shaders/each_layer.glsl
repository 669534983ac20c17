// EACH_LAYER(X): X(0); X(1); ... of LAYERS layers, for outputs, which take constant indices only.
#define EACH_1(X) X(0)
#define EACH_2(X) EACH_1(X); X(1)
#define EACH_3(X) EACH_2(X); X(2)
#define EACH_4(X) EACH_3(X); X(3)
#define EACH_5(X) EACH_4(X); X(4)
#define EACH_6(X) EACH_5(X); X(5)
#define EACH_7(X) EACH_6(X); X(6)
#define EACH_8(X) EACH_7(X); X(7)
#if LAYERS == 1
#define EACH_LAYER(X) EACH_1(X)
#elif LAYERS == 2
#define EACH_LAYER(X) EACH_2(X)
#elif LAYERS == 3
#define EACH_LAYER(X) EACH_3(X)
#elif LAYERS == 4
#define EACH_LAYER(X) EACH_4(X)
#elif LAYERS == 5
#define EACH_LAYER(X) EACH_5(X)
#elif LAYERS == 6
#define EACH_LAYER(X) EACH_6(X)
#elif LAYERS == 7
#define EACH_LAYER(X) EACH_7(X)
#else
#define EACH_LAYER(X) EACH_8(X)
#endif
