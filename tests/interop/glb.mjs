// A .glb, knowing nothing of splats: what the checks compare others with, and what they edit.
import fs from 'node:fs';

const kComponents = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4 };

export function readGlb(path) {
    const file = fs.readFileSync(path);
    const jsonBytes = file.readUInt32LE(12);
    const json = JSON.parse(file.subarray(20, 20 + jsonBytes).toString());
    const begin = 20 + jsonBytes + 8;
    return { json, bin: Buffer.from(file.subarray(begin, begin + file.readUInt32LE(begin - 8))) };
}

export function writeGlb(path, { json, bin }) {
    const pad = (bytes, fill) => Buffer.concat([bytes, Buffer.alloc(-bytes.length & 3, fill)]);
    const chunk = (type, bytes) => {
        const head = Buffer.alloc(8);
        head.writeUInt32LE(bytes.length, 0), head.write(type, 4, 'latin1');
        return Buffer.concat([head, bytes]);
    };
    const chunks = Buffer.concat([chunk('JSON', pad(Buffer.from(JSON.stringify(json)), ' ')), chunk('BIN\0', pad(bin, 0))]);
    const head = Buffer.alloc(12);
    head.write('glTF', 0, 'latin1'), head.writeUInt32LE(2, 4), head.writeUInt32LE(12 + chunks.length, 8);
    fs.writeFileSync(path, Buffer.concat([head, chunks]));
}

export const splatsOf = (glb) => glb.json.meshes[0].primitives[0];

/// Attribute `name`, tight: Float32Array or Uint8Array.
export function attribute(glb, name) {
    const accessor = glb.json.accessors[splatsOf(glb).attributes[name]], view = glb.json.bufferViews[accessor.bufferView];
    const Type = accessor.componentType === 5126 ? Float32Array : Uint8Array;
    const n = kComponents[accessor.type], bytes = n * Type.BYTES_PER_ELEMENT, out = Buffer.alloc(bytes * accessor.count);
    for (let i = 0; i < accessor.count; ++i) {
        const at = (view.byteOffset ?? 0) + (accessor.byteOffset ?? 0) + i * (view.byteStride ?? bytes);
        glb.bin.copy(out, i * bytes, at, at + bytes);
    }
    return new Type(out.buffer, out.byteOffset, n * accessor.count);
}

export const lookNames = (glb) => Object.keys(splatsOf(glb).attributes).filter((name) => !name.startsWith('_'));

/// Exits with 1 unless all `found` (name -> numbers) are those of the file, and no attribute that viewers know is missing.
export function expectAttributes(glb, found, who, names = lookNames(glb)) {
    for (const name of names) {
        const wanted = attribute(glb, name), got = found[name];
        const wrong = !got ? 0 : got.length !== wanted.length ? -1 : wanted.findIndex((x, i) => x !== got[i]);
        if (!got || wrong !== -1 || got.length !== wanted.length) {
            console.log(`FAILED: ${who} reads another ${name}: ` + (!got ? 'nothing' : `${got.length} numbers of ${wanted.length}, number ${wrong} ${got[wrong]} instead of ${wanted[wrong]}`));
            process.exit(1);
        }
    }
    console.log(`${who}: ${names.length} attributes of ${attribute(glb, 'KHR_gaussian_splatting:OPACITY').length} splats, all equal`);
}
