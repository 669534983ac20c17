/* The smallest host of the Nacre runtime by OSMesa: Mesa draws into memory, with no window system, device or driver.
 *   hello_osmesa ASSET.glb OUT.ppm                                                                              */
#include <GL/osmesa.h>
#include <nacre/nacre.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

enum { kSize = 512 };
static float pixels[kSize * kSize * 4]; /* the frame itself: linear floats, as splats want it */

static void* getProcAddress(const char* name, void* user) { (void)user; return (void*)OSMesaGetProcAddress(name); }
static void printMessage(NacreSeverity severity, const char* text, void* user) { (void)severity, (void)user; fprintf(stderr, "nacre: %s\n", text); }
static int fail(const char* text) { fprintf(stderr, "hello_osmesa: %s\n", text); return 1; }

/* A GL 3.3 core context whose window is the array above. */
static int makeContext(void)
{
    const int attributes[] = {OSMESA_PROFILE, OSMESA_CORE_PROFILE, OSMESA_CONTEXT_MAJOR_VERSION, 3, OSMESA_CONTEXT_MINOR_VERSION, 3, 0};
    OSMesaContext context = OSMesaCreateContextAttribs(attributes, NULL);
    if (!context || !OSMesaMakeCurrent(context, pixels, GL_FLOAT, kSize, kSize)) return 0;
    glClear(GL_COLOR_BUFFER_BIT);
    return 1;
}

/* The asset upright in front of a camera that looks along -Z; returns their distance. */
static float frame(NacreAsset asset, NacreInstanceDesc* instance, NacreDrawDesc* draw)
{
    NacreAssetInfo info = {.structSize = sizeof info};
    if (nacreAssetGetInfo(asset, &info) != NACRE_OK) return 0;
    const float x = info.yUpFromAsset[0], y = info.yUpFromAsset[1], z = info.yUpFromAsset[2], w = info.yUpFromAsset[3];
    const float columns[9] = {1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y), 2 * (x * y - w * z), 1 - 2 * (x * x + z * z),
                              2 * (y * z + w * x),     2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)};
    float diagonal2 = 0;
    for (int c = 0; c < 3; ++c) {
        const float extent = info.boundsMax[c] - info.boundsMin[c], centre = 0.5f * (info.boundsMax[c] + info.boundsMin[c]);
        diagonal2 += extent * extent;
        for (int row = 0; row < 3; ++row) {
            instance->worldFromAsset[4 * c + row] = columns[3 * c + row];
            instance->worldFromAsset[12 + row] -= columns[3 * c + row] * centre;
        }
        draw->viewFromWorld[5 * c] = 1;
    }
    const float distance = 1.5f * sqrtf(diagonal2) + 0.02f;
    instance->worldFromAsset[15] = draw->viewFromWorld[15] = 1;
    draw->viewFromWorld[14] = -distance;
    draw->clipFromView[0] = draw->clipFromView[5] = 2.4f; /* 45 degrees */
    draw->clipFromView[10] = draw->clipFromView[11] = -1; /* infinite far plane, near plane at 0.01 */
    draw->clipFromView[14] = -0.02f;
    return distance;
}

static int writePicture(const char* path)
{
    FILE* out = fopen(path, "wb");
    if (!out) return fail("cannot open the output");
    fprintf(out, "P6 %d %d 255\n", kSize, kSize);
    for (int y = kSize - 1; y >= 0; --y) /* GL rows run bottom to top */
        for (int x = 0; x < kSize; ++x)
            for (int c = 0; c < 3; ++c) fputc((int)(255.0f * powf(fminf(pixels[4 * (y * kSize + x) + c], 1.0f), 1 / 2.2f) + 0.5f), out);
    return fclose(out) == 0 ? 0 : fail("cannot write the output");
}

int main(int argc, char** argv)
{
    if (argc != 3) return fail("usage: hello_osmesa ASSET.glb OUT.ppm");
    FILE* in = fopen(argv[1], "rb");
    if (!in || fseek(in, 0, SEEK_END) != 0) return fail("cannot open the asset");
    const size_t size = (size_t)ftell(in);
    void* bytes = malloc(size);
    rewind(in);
    if (!bytes || fread(bytes, 1, size, in) != size) return fail("cannot read the asset");
    fclose(in);

    if (!makeContext()) return fail("OSMesa makes no OpenGL 3.3 core context");

    NacreContext context;
    const NacreContextDesc contextDesc = {.structSize = sizeof contextDesc, .getProcAddress = getProcAddress, .message = printMessage};
    NacreInstanceDesc instanceDesc = {.structSize = sizeof instanceDesc};
    NacreDrawDesc draw = {.structSize = sizeof draw, .viewportWidth = kSize, .viewportHeight = kSize};
    NacreInstance instance;
    NacreView view;
    if (nacreContextCreate(&contextDesc, &context) != NACRE_OK || nacreAssetCreate(context, bytes, size, &instanceDesc.asset) != NACRE_OK) return 1;
    free(bytes);
    const float d = frame(instanceDesc.asset, &instanceDesc, &draw), i = 6 * d * d; /* irradiance i / r^2 of about 2 */
    if (nacreInstanceCreate(&instanceDesc, &instance) != NACRE_OK || nacreViewCreate(context, NULL, &view) != NACRE_OK) return 1;
    const NacreLight light = {.structSize = sizeof light, .position = {d, d, d}, .intensity = {i, i, i}};
    if (nacreContextSetLights(context, &light, 1) != NACRE_OK || nacreViewDraw(view, &draw) != NACRE_OK) return 1;
    glFinish();
    nacreContextDestroy(context); /* and all that is in it */
    return writePicture(argv[2]);
}
