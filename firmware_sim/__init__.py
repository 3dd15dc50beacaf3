"""A virtual TMS320C32 strapdown-navigation board."""
