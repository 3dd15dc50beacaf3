"""The navigation kernels: elementary functions, Earth, attitude and the strapdown solver."""
