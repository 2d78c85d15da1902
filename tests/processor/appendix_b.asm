.text
B000: NOP
      READ    0    D1      -- Initialize matrix "A"
      READ    1    D1
      READ    2    D1
      READ    3    D1
      READ    4    D1
      READ    5    D1
      READ    6    D1
      READ    7    D1
      READ    8    D1
      NOP
      READ    0    D2      -- Initialize matrix "At"
      READ    1    D2
      READ    2    D2
      READ    3    D2
      READ    4    D2
      READ    5    D2
      READ    6    D2
      READ    7    D2
      READ    8    D2
      NOP
      READ    0    D3      -- Initialize matrix "Q"
      READ    1    D3
      READ    2    D3
      READ    3    D3
      READ    4    D3
      READ    5    D3
      READ    6    D3
      READ    7    D3
      READ    8    D3
      NOP
      READ    0    D4      -- Initialize matrix "H"
      READ    1    D4
      READ    2    D4
      READ    3    D4
      READ    4    D4
      READ    5    D4
READ      6      D4
READ      7      D4
READ      8      D4
NOP
READ      0      D5      -- Initialize matrix "R"
READ      1      D5
READ      2      D5
READ      3      D5
READ      4      D5
READ      5      D5
READ      6      D5
READ      7      D5
READ      8      D5
NOP
READ      0      D6      -- Initialize matrix "Ht"
READ      1      D6
READ      2      D6
READ      3      D6
READ      4      D6
READ      5      D6
READ      6      D6
READ      7      D6
READ      8      D6
NOP
READ      0      D9      -- Initialize matrix "H6"
READ      1      D9
READ      2      D9
READ      3      D9
READ      4      D9
READ      5      D9
READ      6      D9
READ      7      D9
READ      8      D9
NOP
READ      0      D10     -- Initialize matrix "H7"
READ      1      D10
READ      2      D10
READ      3      D10
READ      4      D10
READ      5      D10
READ      6      D10
READ      7      D10
READ      8      D10
NOP
READ      0      D16      -- Initialize matrix "H16"
READ      1      D16
READ      2      D16
READ      3      D16
READ      4      D16
READ      5      D16
READ      6      D16
READ      7      D16
READ      8      D16
L1:  NOP
      MULT_33      D1      D9      D8      -- KF Implementation Code
      MULT_33      D1      D10     T1
      MULT_33      T1      D2      T2
      ADD_33       T2      D3      D11
      MULT_33      D4      D8      D12
      MULT_33      D4      D11     T1
      MULT_33      T1      D6      T2
      ADD_33       T2      D5      D14
      ADD_33       D16     ND12    D15
      NOP
      WRITE      D14     0          -- Updating result of computation
      WRITE      D14     1
      WRITE      D14     2
      WRITE      D14     3
      WRITE      D14     4
      WRITE      D14     5
      WRITE      D14     6
      WRITE      D14     7
      WRITE      D14     8
      NOP
      READ      0      D18      -- Read next input
      READ      1      D18
      READ      2      D18
      READ      3      D18
      READ      4      D18
      READ      5      D18
READ      6      D18
READ      7      D18
READ      8      D18
NOP
MULT_33   D11    D6    T1      -- Continue computation
MULT_33   T1     D18   D17
MULT_33   D17    D15   T1
ADD_33    T1     D8    D19
MULT_33   D17    D4    T1
ADD_33    Di    NT1   T2
MULT_33   T2     D11   D20
ADD_33    D20    Dz    D10
ADD_33    D19    Dz    D9
NOP
NOP
JUMP_U    L1
NOP
NOP
.data
D1:  A      -- Allocating memory for respective matrices
D2:  At
D3:  Q
D4:  H
D5:  R
D6:  Ht
D7:  H4
D8:  H5
D9:  H6
D10: H7
D11: H8
D12: H9
ND12: H10
D13: H11
D14: H12
D15: H13
D16: H14
 D17: H15
 D18: H16
 D19: H17
 D20: H18
 T1: H19
 T2: H20
 NT1: H21
 Dz: H22
 Di: H23
