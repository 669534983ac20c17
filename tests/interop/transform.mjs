// transform.mjs reverse|crop IN OUT: as edit.mjs, through gltf-transform. That drops extensions it does not know, so this registers one that
// only keeps its text: what whoever edits such files must do.
import { Extension, ExtensionProperty, NodeIO, PropertyType } from '@gltf-transform/core';

const [how, input, output] = process.argv.slice(2);
class Kept extends ExtensionProperty {
    static EXTENSION_NAME = 'KHR_gaussian_splatting';
    init() { this.extensionName = Kept.EXTENSION_NAME, this.propertyType = 'Splats', this.parentTypes = [PropertyType.PRIMITIVE]; }
}
class KeptSplats extends Extension {
    static EXTENSION_NAME = Kept.EXTENSION_NAME;
    extensionName = Kept.EXTENSION_NAME;
    texts = new Map();
    read(context) {
        context.jsonDoc.json.meshes.forEach((mesh, m) => mesh.primitives.forEach((p, i) => {
            const kept = new Kept(this.document.getGraph());
            kept.setExtras({ text: p.extensions[this.extensionName] });
            context.meshes[m].listPrimitives()[i].setExtension(this.extensionName, kept);
        }));
        return this;
    }
    write(context) {
        this.document.getRoot().listMeshes().forEach((mesh, m) => mesh.listPrimitives().forEach((p, i) => {
            const kept = p.getExtension(this.extensionName);
            if (kept) (context.jsonDoc.json.meshes[m].primitives[i].extensions ??= {})[this.extensionName] = kept.getExtras().text;
        }));
        return this;
    }
}
const io = new NodeIO().registerExtensions([KeptSplats]);
const document = await io.read(input);
for (const mesh of document.getRoot().listMeshes())
    for (const primitive of mesh.listPrimitives()) {
        const count = primitive.getAttribute('POSITION').getCount(), order = [...Array(count).keys()].reverse();
        if (how === 'crop') order.length = count >> 1;
        for (const accessor of new Set(primitive.listAttributes())) {
            const values = accessor.getArray(), n = accessor.getElementSize(), out = new values.constructor(order.length * n);
            order.forEach((from, to) => out.set(values.subarray(from * n, (from + 1) * n), to * n));
            accessor.setArray(out);
        }
    }
await io.write(output, document);
