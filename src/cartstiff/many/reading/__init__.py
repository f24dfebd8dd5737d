"""What is read of many postures by the machine code that makes their matrices."""
