// edit.mjs reverse|crop|move IN OUT: what any script might do to the splats of a file, by every attribute it finds there.
import { readGlb, writeGlb, attribute, splatsOf } from './glb.mjs';

const [how, input, output] = process.argv.slice(2);
const glb = readGlb(input), { json } = glb, primitive = splatsOf(glb);
const count = json.accessors[primitive.attributes.POSITION].count;
let order = [...Array(count).keys()];
if (how === 'reverse') order.reverse();
if (how === 'crop') { // the right half
    const x = attribute(glb, 'POSITION').filter((_, i) => i % 3 === 0), middle = x.toSorted()[count >> 1];
    order = order.filter((i) => x[i] > middle);
}
const parts = [], views = [], accessors = [];
let offset = 0;
for (const [name, index] of Object.entries(primitive.attributes)) {
    const values = attribute(glb, name), n = values.length / count, out = new values.constructor(order.length * n);
    order.forEach((from, to) => out.set(values.subarray(from * n, (from + 1) * n), to * n));
    if (how === 'move' && name === 'POSITION') out.forEach((x, i) => { out[i] = 1.5 * x + 1; });
    const { type, componentType } = json.accessors[index], accessor = { bufferView: views.length, componentType, type, count: order.length };
    if (name === 'POSITION')
        for (const [key, pick] of [['min', Math.min], ['max', Math.max]])
            accessor[key] = [0, 1, 2].map((c) => out.reduce((best, x, i) => (i % 3 === c ? pick(best, x) : best), out[c]));
    primitive.attributes[name] = accessors.length;
    accessors.push(accessor), views.push({ buffer: 0, byteOffset: offset, byteLength: out.byteLength, target: 34962 });
    parts.push(Buffer.from(out.buffer)), offset += out.byteLength;
}
json.accessors = accessors, json.bufferViews = views, json.buffers = [{ byteLength: offset }];
writeGlb(output, { json, bin: Buffer.concat(parts) });
