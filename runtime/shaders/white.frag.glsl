// All light arrives.
layout(location = 0) out vec4 outArriving;

void main() { outArriving = vec4(1.0); }
