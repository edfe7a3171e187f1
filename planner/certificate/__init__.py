"""The certificate: a bound of every limit over continuous time, which trusts no solver; and what it advises."""
