// A thin layer over nacre.h for C++17: what owns an id destroys it, structs come with their size, results are values. Nothing throws and
// nothing is hidden: every object gives its id for what is not here. Objects may outlive those they came from; they are stale then.
//
//   auto context = nacre::runtime::Context::create(desc);
//   if (!context) return context.code; // the message callback has said why
#pragma once

#include "nacre.h"

#include <cstddef>
#include <cstdint>
#include <iterator>
#include <utility>

namespace nacre::runtime {

/// Zeroed, with its structSize.
template <class Struct>
Struct make()
{
    Struct s{};
    s.structSize = sizeof s;
    return s;
}

/// `value` counts only with NACRE_OK.
template <class Value>
struct Result {
    NacreResult code = NACRE_OK;
    Value value{};

    explicit operator bool() const { return code == NACRE_OK; }
    Value& operator*() { return value; }
    Value* operator->() { return &value; }
};

/// Move-only; destroys its id.
template <class Id, void (*destroy)(Id)>
class Owner {
public:
    Owner() = default;
    explicit Owner(Id id) : id_(id) {}
    Owner(Owner&& other) noexcept : id_(other.release()) {}
    Owner& operator=(Owner&& other) noexcept { return reset(other.release()), *this; }
    ~Owner() { destroy(id_); } // 0 and stale ids are allowed

    Id id() const { return id_; }
    explicit operator bool() const { return id_.id != 0; }
    Id release() { return std::exchange(id_, Id{}); }
    void reset(Id id = {}) { destroy(std::exchange(id_, id)); }

private:
    Id id_{};
};

namespace detail {
/// A call that fills one object.
template <class Object, class Id, class Call>
Result<Object> created(Call call)
{
    Id id{};
    const NacreResult code = call(&id);
    return {code, Object(id)};
}
/// A call that fills one struct.
template <class Struct, class Id>
Result<Struct> got(NacreResult (*get)(Id, Struct*), Id id)
{
    Result<Struct> result{NACRE_OK, make<Struct>()};
    result.code = get(id, &result.value);
    return result;
}
} // namespace detail

class Instance : public Owner<NacreInstance, nacreInstanceDestroy> {
public:
    using Owner::Owner;
    static Result<Instance> create(const NacreInstanceDesc& desc)
    {
        return detail::created<Instance, NacreInstance>([&](NacreInstance* i) { return nacreInstanceCreate(&desc, i); });
    }
    NacreResult setTransform(const float (&worldFromAsset)[16]) { return nacreInstanceSetTransform(id(), worldFromAsset); }
    NacreResult setHidden(bool hidden) { return nacreInstanceSetHidden(id(), hidden); }
    NacreResult setMasks(uint32_t lights, uint32_t views) { return nacreInstanceSetMasks(id(), lights, views); }
    NacreResult setTint(const float (&tint)[3]) { return nacreInstanceSetTint(id(), tint); }
    template <class Edits>
    NacreResult setEdits(const Edits& edits) { return nacreInstanceSetEdits(id(), std::data(edits), std::size(edits)); }
};

class Asset : public Owner<NacreAsset, nacreAssetDestroy> {
public:
    using Owner::Owner;
    Result<NacreAssetInfo> info() const { return detail::got(nacreAssetGetInfo, id()); }
    /// The value: bytes left.
    Result<uint64_t> uploadStep(uint64_t budgetBytes)
    {
        Result<uint64_t> left;
        left.code = nacreAssetUploadStep(id(), budgetBytes, &left.value);
        return left;
    }
    /// At the origin of the world.
    Result<Instance> instance() const
    {
        NacreInstanceDesc desc = make<NacreInstanceDesc>();
        desc.asset = id();
        return Instance::create(desc);
    }
};

class View : public Owner<NacreView, nacreViewDestroy> {
public:
    using Owner::Owner;
    NacreResult draw(const NacreDrawDesc& desc) { return nacreViewDraw(id(), &desc); }
    NacreResult drawDepth(const NacreDrawDesc& desc) { return nacreViewDrawDepth(id(), &desc); }
    /// Without `desc` only programs are compiled.
    NacreResult prepare(size_t mostLights, const NacreDrawDesc* desc = nullptr) { return nacreViewPrepare(id(), desc, mostLights); }
    Result<NacreDrawStats> stats() const { return detail::got(nacreViewGetStats, id()); }
};

class Context : public Owner<NacreContext, nacreContextDestroy> {
public:
    using Owner::Owner;
    static Result<Context> create(const NacreContextDesc& desc)
    {
        return detail::created<Context, NacreContext>([&](NacreContext* c) { return nacreContextCreate(&desc, c); });
    }
    Result<Asset> loadAsset(const void* bytes, size_t size, const NacreDetail* reduced = nullptr)
    {
        return detail::created<Asset, NacreAsset>([&](NacreAsset* a) { return nacreAssetCreateDetail(id(), bytes, size, reduced, a); });
    }
    /// On any thread; then Asset::uploadStep.
    Result<Asset> decodeAsset(const void* bytes, size_t size, const NacreDetail* reduced = nullptr) const
    {
        return detail::created<Asset, NacreAsset>([&](NacreAsset* a) { return nacreAssetDecodeDetail(id(), bytes, size, reduced, a); });
    }
    Result<View> view(uint32_t mask = 0)
    {
        NacreViewDesc desc = make<NacreViewDesc>();
        desc.mask = mask;
        return detail::created<View, NacreView>([&](NacreView* v) { return nacreViewCreate(id(), &desc, v); });
    }
    template <class Lights>
    NacreResult setLights(const Lights& lights) { return nacreContextSetLights(id(), std::data(lights), std::size(lights)); }
    /// Null: none.
    NacreResult setEnvironment(const NacreEnvironment* environment) { return nacreContextSetEnvironment(id(), environment); }
    Result<NacreContextInfo> info() const { return detail::got(nacreContextGetInfo, id()); }
};

} // namespace nacre::runtime
