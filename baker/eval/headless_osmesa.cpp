// OSMesa: Mesa drawing into memory of the process, without a window system, a device or EGL. Opened when it is asked for, so that nothing
// depends on it. The only file that knows OSMesa.
#include "eval/headless_context.h"

#if __has_include(<GL/osmesa.h>) && __has_include(<dlfcn.h>)
#include <GL/osmesa.h>
#include <dlfcn.h>
#define NACRE_HAVE_OSMESA 1
#endif

namespace nacre {

#ifdef NACRE_HAVE_OSMESA
namespace {

struct OsMesaLibrary {
    decltype(&OSMesaCreateContextAttribs) create = nullptr;
    decltype(&OSMesaDestroyContext) destroy = nullptr;
    decltype(&OSMesaMakeCurrent) makeCurrent = nullptr;
    decltype(&OSMesaGetProcAddress) getProcAddress = nullptr;

    OsMesaLibrary()
    {
        void* library = dlopen("libOSMesa.so.8", RTLD_NOW | RTLD_LOCAL); // its gl functions must not stand before those of libOpenGL
        if (!library) return;
        const auto find = [&](auto& function, const char* name) { function = reinterpret_cast<std::decay_t<decltype(function)>>(dlsym(library, name)); };
        find(create, "OSMesaCreateContextAttribs"), find(destroy, "OSMesaDestroyContext");
        find(makeCurrent, "OSMesaMakeCurrent"), find(getProcAddress, "OSMesaGetProcAddress");
    }
    bool complete() const { return create && destroy && makeCurrent && getProcAddress; }
};

const OsMesaLibrary& osMesa()
{
    static const OsMesaLibrary library;
    return library;
}

class OsMesaHeadless final : public HeadlessContext {
public:
    ~OsMesaHeadless() override { osMesa().destroy(context); }
    bool makeCurrent() override { return osMesa().makeCurrent(context, window_, GL_UNSIGNED_BYTE, kSide, kSide); }
    void release() override { osMesa().makeCurrent(nullptr, nullptr, 0, 0, 0); }
    void* getProcAddress(const char* name) override { return reinterpret_cast<void*>(osMesa().getProcAddress(name)); }

    OSMesaContext context = nullptr;

private:
    static constexpr int kSide = 4; // of the default framebuffer, which nobody draws into
    unsigned char window_[4 * kSide * kSide];
};

} // namespace

Result<std::unique_ptr<HeadlessContext>> makeOsMesaContext()
{
    if (!osMesa().complete()) return Error{ErrorCode::kGpu, "no OSMesa context: libOSMesa.so.8 is missing; install libosmesa6"};
    static const int kAttributes[] = {OSMESA_FORMAT, OSMESA_RGBA, OSMESA_PROFILE, OSMESA_CORE_PROFILE, OSMESA_CONTEXT_MAJOR_VERSION, 3,
                                      OSMESA_CONTEXT_MINOR_VERSION, 3, 0};
    auto made = std::make_unique<OsMesaHeadless>();
    made->context = osMesa().create(kAttributes, nullptr);
    if (!made->context) return Error{ErrorCode::kGpu, "OSMesa cannot make an OpenGL 3.3 core context"};
    made->software = true;
    return std::unique_ptr<HeadlessContext>(std::move(made));
}
#else
Result<std::unique_ptr<HeadlessContext>> makeOsMesaContext()
{
    return Error{ErrorCode::kGpu, "no OSMesa context: this program was built without GL/osmesa.h; install libosmesa6-dev and build again"};
}
#endif

} // namespace nacre
