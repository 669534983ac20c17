#include "capture_spec.h"

#include "base/text.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <set>

namespace nacre::cli {
namespace {

enum For : unsigned { kOfStage = 1, kOfPhone = 2, kOfBoth = 3 };

struct Key {
    const char* name;
    double CaptureOptions::*value;
    const char* unit;
    double low, high;
    unsigned kinds;
    const char* help;
    bool whole = false;
};

constexpr Key kKeys[] = {
    {"light-error", &CaptureOptions::lightError, "deg", 0, 45, kOfStage, "direction of each light is off by so much (rms)"},
    {"turn", &CaptureOptions::turn, "deg", -180, 180, kOfStage, "all lights together are turned about the vertical"},
    {"gain", &CaptureOptions::gain, "%", 0, 100, kOfStage, "power of each light (rms)"},
    {"pose", &CaptureOptions::pose, "deg", 0, 10, kOfBoth, "rotation of each camera (rms)"},
    {"place", &CaptureOptions::place, "mm", 0, 100, kOfBoth, "position of each camera (rms)"},
    {"exposure", &CaptureOptions::exposure, "ev", 0, 3, kOfBoth, "exposure of each image (rms)"},
    {"lens", &CaptureOptions::lens, "%", 0, 150, kOfBoth, "distortion, of a usual lens; stated exactly"},
    {"electrons", &CaptureOptions::electrons, "e", 0, 1e7, kOfBoth, "of a saturated pixel (shot noise); 0: no noise"},
    {"read", &CaptureOptions::read, "e", 0, 1e5, kOfBoth, "noise of reading (rms)"},
    {"jpeg", &CaptureOptions::jpeg, "", 0, 100, kOfBoth, "quality of JPEG files, 92 if no number is given; 0: PNG", true},
    {"spill", &CaptureOptions::spill, "px", 0, 64, kOfStage, "mattes are too wide by so much, and as soft"},
    {"holes", &CaptureOptions::holes, "", 0, 1000, kOfStage, "in each matte", true},
    {"blank", &CaptureOptions::blank, "%", 0, 100, kOfStage, "of the cameras have an empty matte"},
    {"backdrop", &CaptureOptions::backdrop, "%", 0, 100, kOfStage, "brightness behind the object"},
    {"flash", &CaptureOptions::flash, "cm", 0, 100, kOfPhone, "from the camera to its flash; stated at the camera"},
    {"beam", &CaptureOptions::beam, "", 0, 100, kOfPhone, "intensity of the flash falls as cos^beam from the camera's axis"},
    {"ambient", &CaptureOptions::ambient, "%", 0, 1000, kOfPhone, "light of the room, of the flash's"},
    {"size", &CaptureOptions::size, "cm", 0.01, 1e5, kOfBoth, "diameter of the object"},
};

unsigned bitOf(CaptureKind kind) { return kind == CaptureKind::kStage ? kOfStage : kOfPhone; }
const char* nameOf(CaptureKind kind) { return kind == CaptureKind::kStage ? "stage" : "phone"; }

Error bad(const std::string& text, const std::string& what) { return {ErrorCode::kBadInput, "--capture " + inQuotes(text) + ": " + what}; }

std::string keysOf(CaptureKind kind)
{
    std::string names = "clean";
    for (const Key& key : kKeys)
        if (key.kinds & bitOf(kind)) names.append(", ").append(key.name);
    return names + (kind == CaptureKind::kPhone ? ", lights-off" : "");
}

Status setOne(CaptureOptions& o, const std::string& text, const std::string& part, std::set<std::string>& given)
{
    const size_t equals = part.find('=');
    const std::string name = part.substr(0, equals);
    if (part.empty()) return bad(text, "a key is missing beside ':' or ','; there are: " + keysOf(o.kind));
    if (!given.insert(name == "png" ? "jpeg" : name).second) return bad(text, inQuotes(name) + " says again, or otherwise, what was said before; say it once");
    const bool isFlag = name == "clean" || name == "png" || (name == "lights-off" && o.kind == CaptureKind::kPhone);
    if (isFlag && equals != std::string::npos) return bad(text, inQuotes(name) + " takes no value, found " + inQuotes(part) + "; leave it out for the opposite");
    if (name == "clean") return o.clean = true, ok();
    if (name == "lights-off" && isFlag) return o.lightsOff = true, ok();
    if (part == "jpeg") return o.jpeg = 92, ok();
    if (name == "png") return o.jpeg = 0, ok();
    const auto key = std::find_if(std::begin(kKeys), std::end(kKeys), [&](const Key& k) { return name == k.name && (k.kinds & bitOf(o.kind)); });
    if (key == std::end(kKeys)) return bad(text, "a " + std::string(nameOf(o.kind)) + " has no " + inQuotes(name) + "; it has: " + keysOf(o.kind));
    const std::string value = equals == std::string::npos ? "" : part.substr(equals + 1);
    char* end = nullptr;
    const double number = std::strtod(value.c_str(), &end);
    const bool isNumber = end != value.c_str() && (*end == '\0' || std::string(end) == key->unit);
    if (!isNumber || !(number >= key->low && number <= key->high) || (key->whole && number != std::floor(number)))
        return bad(text, "expected " + name + (key->whole ? " a whole number from " : " from ") + numberText(key->low) + " to " + numberText(key->high) +
                             (*key->unit ? std::string(" ") + key->unit : "") + ", found " + inQuotes(part));
    o.*key->value = number;
    return ok();
}

} // namespace

Result<CaptureOptions> parseCapture(const std::string& text)
{
    const size_t colon = text.find(':');
    const std::string kind = text.substr(0, colon);
    if (kind != "stage" && kind != "phone") return bad(text, "expected stage or phone, then :KEY=VALUE,...");
    CaptureOptions o = usualCapture(kind == "stage" ? CaptureKind::kStage : CaptureKind::kPhone);
    std::set<std::string> given;
    for (size_t at = colon; at != std::string::npos;) {
        const size_t next = text.find(',', at + 1);
        if (Status s = setOne(o, text, text.substr(at + 1, next == std::string::npos ? next : next - at - 1), given); !s) return s.error();
        at = next;
    }
    if (o.clean && given.size() > 1) return bad(text, "clean leaves every error out, beside it nothing else counts; say clean alone or not at all");
    return o;
}

std::string textOf(const CaptureOptions& o)
{
    std::string text = nameOf(o.kind);
    if (o.clean) return text + ":clean";
    char separator = ':';
    for (const Key& key : kKeys) {
        if (!(key.kinds & bitOf(o.kind))) continue;
        text.append(1, separator).append(key.name).append(1, '=').append(numberText(o.*key.value)).append(key.unit);
        separator = ',';
    }
    return text + (o.lightsOff ? ",lights-off" : "");
}

std::string captureKeys()
{
    const CaptureOptions stage = usualCapture(CaptureKind::kStage), phone = usualCapture(CaptureKind::kPhone);
    std::string text;
    for (const Key& key : kKeys) {
        text.append("  ").append(key.name).append(" (").append(key.unit).append(*key.unit ? "; " : "");
        if (key.kinds & kOfStage) text += "stage " + numberText(stage.*key.value);
        if (key.kinds == kOfBoth) text += ", ";
        if (key.kinds & kOfPhone) text += "phone " + numberText(phone.*key.value);
        text.append("): ").append(key.help).append(1, '\n');
    }
    return text + "  lights-off: phone, each view once more without the flash; clean: the same cameras and lights without errors";
}

} // namespace nacre::cli
