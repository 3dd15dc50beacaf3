; What the frame holds, as the line describes it (docs/interface-control.md): one byte in a word.

U32         .set    3
I32         .set    4

field       .macro  index,type,name,unit,meaning
            .word   end?-begin?
begin?      .byte   FRAME_TYPE, index, FIELDS, type, 4*index, 0
            .byte   0, 0, 0, 0, 0, 0, 0F0h, 3Fh     ; scale 1.0
            .byte   "raw sums", 0
            .byte   ":name:", 0
            .if     $symlen(unit)
            .byte   ":unit:"
            .endif
            .byte   0
            .byte   ":meaning:", 0
            .byte   0                               ; no labels
end?
            .endm

descriptions:
            field   0,U32,"sequence","","number of the frame since start"
            field   1,U32,"number","","number of the last sample in the sums"
            field   2,U32,"samples","","samples in the sums"
            field   3,I32,"gyro_x","counts","summed gyro counts, x"
            field   4,I32,"gyro_y","counts","summed gyro counts, y"
            field   5,I32,"gyro_z","counts","summed gyro counts, z"
            field   6,I32,"acc_x","counts","summed accelerometer counts, x"
            field   7,I32,"acc_y","counts","summed accelerometer counts, y"
            field   8,I32,"acc_z","counts","summed accelerometer counts, z"
            .word   0
