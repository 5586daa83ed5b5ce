"""What a user may do next: experiments that decide, what the data tell of parameters, remarks, a law as an effect."""
