"""What people do together: they meet, touch, carry things, and work at furniture."""
