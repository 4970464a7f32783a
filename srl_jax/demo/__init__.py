"""The page in which a visitor cuts off a leg: what it carries, and how its template is filled."""
