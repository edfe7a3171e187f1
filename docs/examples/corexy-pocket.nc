(a pocket with rounded corners, from the inside out; corners within 0.02 mm)
G21 G90 G17 G64 P0.02
F6000
G0 X-10 Y0 Z5
G1 Z-2 F600
F6000
G1 X10
Y4
X-10
Y-4
X14
Y8
X-14
Y-8
X15
G3 X20 Y-3 I0 J5
G1 Y7
G3 X15 Y12 I-5 J0
G1 X-15
G3 X-20 Y7 I0 J-5
G1 Y-7
G3 X-15 Y-12 I5 J0
G1 X20 Y-12
G0 Z5
M2
