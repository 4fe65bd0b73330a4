/*! Contains Preact.
The MIT License (MIT)

Copyright (c) 2015-present Jason Miller

Permission is hereby granted, free of charge, to any person obtaining a copy
of this software and associated documentation files (the "Software"), to deal
in the Software without restriction, including without limitation the rights
to use, copy, modify, merge, publish, distribute, sublicense, and/or sell
copies of the Software, and to permit persons to whom the Software is
furnished to do so, subject to the following conditions:

The above copyright notice and this permission notice shall be included in all
copies or substantial portions of the Software.

THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR
IMPLIED, INCLUDING BUT NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY,
FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE
AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER
LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM,
OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE
SOFTWARE.
*/
// node_modules/preact/dist/preact.module.js
var e, t, n, r, i, a, o, s, c, l, u, d = {}, f = [], p = /acit|ex(?:s|g|n|p|$)|rph|grid|ows|mnc|ntw|ine[ch]|zoo|^ord|itera/i, m = Array.isArray;
function h(e, t) {
	for (var n in t) e[n] = t[n];
	return e;
}
function g(e) {
	e && e.parentNode && e.parentNode.removeChild(e);
}
function _(t, n, r) {
	var i, a, o, s = {};
	for (o in n) o == "key" ? i = n[o] : o == "ref" ? a = n[o] : s[o] = n[o];
	if (arguments.length > 2 && (s.children = arguments.length > 3 ? e.call(arguments, 2) : r), typeof t == "function" && t.defaultProps != null) for (o in t.defaultProps) s[o] === void 0 && (s[o] = t.defaultProps[o]);
	return v(t, s, i, a, null);
}
function v(e, r, i, a, o) {
	var s = {
		type: e,
		props: r,
		key: i,
		ref: a,
		__k: null,
		__: null,
		__b: 0,
		__e: null,
		__c: null,
		constructor: void 0,
		__v: o ?? ++n,
		__i: -1,
		__u: 0
	};
	return o == null && t.vnode != null && t.vnode(s), s;
}
function y(e) {
	return e.children;
}
function b(e, t) {
	this.props = e, this.context = t;
}
function x(e, t) {
	if (t == null) return e.__ ? x(e.__, e.__i + 1) : null;
	for (var n; t < e.__k.length; t++) if ((n = e.__k[t]) != null && n.__e != null) return n.__e;
	return typeof e.type == "function" ? x(e) : null;
}
function S(e) {
	var t, n;
	if ((e = e.__) != null && e.__c != null) {
		for (e.__e = e.__c.base = null, t = 0; t < e.__k.length; t++) if ((n = e.__k[t]) != null && n.__e != null) {
			e.__e = e.__c.base = n.__e;
			break;
		}
		return S(e);
	}
}
function C(e) {
	(!e.__d && (e.__d = !0) && r.push(e) && !w.__r++ || i != t.debounceRendering) && ((i = t.debounceRendering) || a)(w);
}
function w() {
	for (var e, n, i, a, s, c, l, u = 1; r.length;) r.length > u && r.sort(o), e = r.shift(), u = r.length, e.__d && (i = void 0, a = void 0, s = (a = (n = e).__v).__e, c = [], l = [], n.__P && ((i = h({}, a)).__v = a.__v + 1, t.vnode && t.vnode(i), M(n.__P, i, a, n.__n, n.__P.namespaceURI, 32 & a.__u ? [s] : null, c, s ?? x(a), !!(32 & a.__u), l), i.__v = a.__v, i.__.__k[i.__i] = i, P(c, i, l), a.__e = a.__ = null, i.__e != s && S(i)));
	w.__r = 0;
}
function T(e, t, n, r, i, a, o, s, c, l, u) {
	var p, m, h, g, _, v, y, b = r && r.__k || f, x = t.length;
	for (c = E(n, t, b, c, x), p = 0; p < x; p++) (h = n.__k[p]) != null && (m = h.__i == -1 ? d : b[h.__i] || d, h.__i = p, v = M(e, h, m, i, a, o, s, c, l, u), g = h.__e, h.ref && m.ref != h.ref && (m.ref && I(m.ref, null, h), u.push(h.ref, h.__c || g, h)), _ == null && g != null && (_ = g), (y = !!(4 & h.__u)) || m.__k === h.__k ? c = D(h, c, e, y) : typeof h.type == "function" && v !== void 0 ? c = v : g && (c = g.nextSibling), h.__u &= -7);
	return n.__e = _, c;
}
function E(e, t, n, r, i) {
	var a, o, s, c, l, u = n.length, d = u, f = 0;
	for (e.__k = Array(i), a = 0; a < i; a++) (o = t[a]) != null && typeof o != "boolean" && typeof o != "function" ? (c = a + f, (o = e.__k[a] = typeof o == "string" || typeof o == "number" || typeof o == "bigint" || o.constructor == String ? v(null, o, null, null, null) : m(o) ? v(y, { children: o }, null, null, null) : o.constructor == null && o.__b > 0 ? v(o.type, o.props, o.key, o.ref ? o.ref : null, o.__v) : o).__ = e, o.__b = e.__b + 1, s = null, (l = o.__i = O(o, n, c, d)) != -1 && (d--, (s = n[l]) && (s.__u |= 2)), s == null || s.__v == null ? (l == -1 && (i > u ? f-- : i < u && f++), typeof o.type != "function" && (o.__u |= 4)) : l != c && (l == c - 1 ? f-- : l == c + 1 ? f++ : (l > c ? f-- : f++, o.__u |= 4))) : e.__k[a] = null;
	if (d) for (a = 0; a < u; a++) (s = n[a]) != null && !(2 & s.__u) && (s.__e == r && (r = x(s)), L(s, s));
	return r;
}
function D(e, t, n, r) {
	var i, a;
	if (typeof e.type == "function") {
		for (i = e.__k, a = 0; i && a < i.length; a++) i[a] && (i[a].__ = e, t = D(i[a], t, n, r));
		return t;
	}
	e.__e != t && (r && (t && e.type && !t.parentNode && (t = x(e)), n.insertBefore(e.__e, t || null)), t = e.__e);
	do
		t &&= t.nextSibling;
	while (t != null && t.nodeType == 8);
	return t;
}
function O(e, t, n, r) {
	var i, a, o, s = e.key, c = e.type, l = t[n], u = l != null && !(2 & l.__u);
	if (l === null && e.key == null || u && s == l.key && c == l.type) return n;
	if (r > +!!u) {
		for (i = n - 1, a = n + 1; i >= 0 || a < t.length;) if ((l = t[o = i >= 0 ? i-- : a++]) != null && !(2 & l.__u) && s == l.key && c == l.type) return o;
	}
	return -1;
}
function k(e, t, n) {
	t[0] == "-" ? e.setProperty(t, n ?? "") : e[t] = n == null ? "" : typeof n != "number" || p.test(t) ? n : n + "px";
}
function A(e, t, n, r, i) {
	var a, o;
	n: if (t == "style") {
		if (typeof n == "string") e.style.cssText = n;
		else {
			if (typeof r == "string" && (e.style.cssText = r = ""), r) for (t in r) n && t in n || k(e.style, t, "");
			if (n) for (t in n) r && n[t] == r[t] || k(e.style, t, n[t]);
		}
	} else if (t[0] == "o" && t[1] == "n") a = t != (t = t.replace(s, "$1")), o = t.toLowerCase(), t = o in e || t == "onFocusOut" || t == "onFocusIn" ? o.slice(2) : t.slice(2), e.l ||= {}, e.l[t + a] = n, n ? r ? n.u = r.u : (n.u = c, e.addEventListener(t, a ? u : l, a)) : e.removeEventListener(t, a ? u : l, a);
	else {
		if (i == "http://www.w3.org/2000/svg") t = t.replace(/xlink(H|:h)/, "h").replace(/sName$/, "s");
		else if (t != "width" && t != "height" && t != "href" && t != "list" && t != "form" && t != "tabIndex" && t != "download" && t != "rowSpan" && t != "colSpan" && t != "role" && t != "popover" && t in e) try {
			e[t] = n ?? "";
			break n;
		} catch {}
		typeof n == "function" || (n == null || !1 === n && t[4] != "-" ? e.removeAttribute(t) : e.setAttribute(t, t == "popover" && n == 1 ? "" : n));
	}
}
function j(e) {
	return function(n) {
		if (this.l) {
			var r = this.l[n.type + e];
			if (n.t == null) n.t = c++;
			else if (n.t < r.u) return;
			return r(t.event ? t.event(n) : n);
		}
	};
}
function M(e, n, r, i, a, o, s, c, l, u) {
	var d, f, p, _, v, x, S, C, w, E, D, O, k, A, j, M, P, I = n.type;
	if (n.constructor != null) return null;
	128 & r.__u && (l = !!(32 & r.__u), o = [c = n.__e = r.__e]), (d = t.__b) && d(n);
	n: if (typeof I == "function") try {
		if (C = n.props, w = "prototype" in I && I.prototype.render, E = (d = I.contextType) && i[d.__c], D = d ? E ? E.props.value : d.__ : i, r.__c ? S = (f = n.__c = r.__c).__ = f.__E : (w ? n.__c = f = new I(C, D) : (n.__c = f = new b(C, D), f.constructor = I, f.render = te), E && E.sub(f), f.props = C, f.state || (f.state = {}), f.context = D, f.__n = i, p = f.__d = !0, f.__h = [], f._sb = []), w && f.__s == null && (f.__s = f.state), w && I.getDerivedStateFromProps != null && (f.__s == f.state && (f.__s = h({}, f.__s)), h(f.__s, I.getDerivedStateFromProps(C, f.__s))), _ = f.props, v = f.state, f.__v = n, p) w && I.getDerivedStateFromProps == null && f.componentWillMount != null && f.componentWillMount(), w && f.componentDidMount != null && f.__h.push(f.componentDidMount);
		else {
			if (w && I.getDerivedStateFromProps == null && C !== _ && f.componentWillReceiveProps != null && f.componentWillReceiveProps(C, D), !f.__e && f.shouldComponentUpdate != null && !1 === f.shouldComponentUpdate(C, f.__s, D) || n.__v == r.__v) {
				for (n.__v != r.__v && (f.props = C, f.state = f.__s, f.__d = !1), n.__e = r.__e, n.__k = r.__k, n.__k.some(function(e) {
					e && (e.__ = n);
				}), O = 0; O < f._sb.length; O++) f.__h.push(f._sb[O]);
				f._sb = [], f.__h.length && s.push(f);
				break n;
			}
			f.componentWillUpdate != null && f.componentWillUpdate(C, f.__s, D), w && f.componentDidUpdate != null && f.__h.push(function() {
				f.componentDidUpdate(_, v, x);
			});
		}
		if (f.context = D, f.props = C, f.__P = e, f.__e = !1, k = t.__r, A = 0, w) {
			for (f.state = f.__s, f.__d = !1, k && k(n), d = f.render(f.props, f.state, f.context), j = 0; j < f._sb.length; j++) f.__h.push(f._sb[j]);
			f._sb = [];
		} else do
			f.__d = !1, k && k(n), d = f.render(f.props, f.state, f.context), f.state = f.__s;
		while (f.__d && ++A < 25);
		f.state = f.__s, f.getChildContext != null && (i = h(h({}, i), f.getChildContext())), w && !p && f.getSnapshotBeforeUpdate != null && (x = f.getSnapshotBeforeUpdate(_, v)), M = d, d != null && d.type === y && d.key == null && (M = ee(d.props.children)), c = T(e, m(M) ? M : [M], n, r, i, a, o, s, c, l, u), f.base = n.__e, n.__u &= -161, f.__h.length && s.push(f), S && (f.__E = f.__ = null);
	} catch (e) {
		if (n.__v = null, l || o != null) {
			if (e.then) {
				for (n.__u |= l ? 160 : 128; c && c.nodeType == 8 && c.nextSibling;) c = c.nextSibling;
				o[o.indexOf(c)] = null, n.__e = c;
			} else {
				for (P = o.length; P--;) g(o[P]);
				N(n);
			}
		} else n.__e = r.__e, n.__k = r.__k, e.then || N(n);
		t.__e(e, n, r);
	}
	else o == null && n.__v == r.__v ? (n.__k = r.__k, n.__e = r.__e) : c = n.__e = F(r.__e, n, r, i, a, o, s, l, u);
	return (d = t.diffed) && d(n), 128 & n.__u ? void 0 : c;
}
function N(e) {
	e && e.__c && (e.__c.__e = !0), e && e.__k && e.__k.forEach(N);
}
function P(e, n, r) {
	for (var i = 0; i < r.length; i++) I(r[i], r[++i], r[++i]);
	t.__c && t.__c(n, e), e.some(function(n) {
		try {
			e = n.__h, n.__h = [], e.some(function(e) {
				e.call(n);
			});
		} catch (e) {
			t.__e(e, n.__v);
		}
	});
}
function ee(e) {
	return typeof e != "object" || !e || e.__b && e.__b > 0 ? e : m(e) ? e.map(ee) : h({}, e);
}
function F(n, r, i, a, o, s, c, l, u) {
	var f, p, h, _, v, y, b, S = i.props, C = r.props, w = r.type;
	if (w == "svg" ? o = "http://www.w3.org/2000/svg" : w == "math" ? o = "http://www.w3.org/1998/Math/MathML" : o ||= "http://www.w3.org/1999/xhtml", s != null) {
		for (f = 0; f < s.length; f++) if ((v = s[f]) && "setAttribute" in v == !!w && (w ? v.localName == w : v.nodeType == 3)) {
			n = v, s[f] = null;
			break;
		}
	}
	if (n == null) {
		if (w == null) return document.createTextNode(C);
		n = document.createElementNS(o, w, C.is && C), l &&= (t.__m && t.__m(r, s), !1), s = null;
	}
	if (w == null) S === C || l && n.data == C || (n.data = C);
	else {
		if (s &&= e.call(n.childNodes), S = i.props || d, !l && s != null) for (S = {}, f = 0; f < n.attributes.length; f++) S[(v = n.attributes[f]).name] = v.value;
		for (f in S) if (v = S[f], f != "children") {
			if (f == "dangerouslySetInnerHTML") h = v;
			else if (!(f in C)) {
				if (f == "value" && "defaultValue" in C || f == "checked" && "defaultChecked" in C) continue;
				A(n, f, null, v, o);
			}
		}
		for (f in C) v = C[f], f == "children" ? _ = v : f == "dangerouslySetInnerHTML" ? p = v : f == "value" ? y = v : f == "checked" ? b = v : l && typeof v != "function" || S[f] === v || A(n, f, v, S[f], o);
		if (p) l || h && (p.__html == h.__html || p.__html == n.innerHTML) || (n.innerHTML = p.__html), r.__k = [];
		else if (h && (n.innerHTML = ""), T(r.type == "template" ? n.content : n, m(_) ? _ : [_], r, i, a, w == "foreignObject" ? "http://www.w3.org/1999/xhtml" : o, s, c, s ? s[0] : i.__k && x(i, 0), l, u), s != null) for (f = s.length; f--;) g(s[f]);
		l || (f = "value", w == "progress" && y == null ? n.removeAttribute("value") : y != null && (y !== n[f] || w == "progress" && !y || w == "option" && y != S[f]) && A(n, f, y, S[f], o), f = "checked", b != null && b != n[f] && A(n, f, b, S[f], o));
	}
	return n;
}
function I(e, n, r) {
	try {
		if (typeof e == "function") {
			var i = typeof e.__u == "function";
			i && e.__u(), i && n == null || (e.__u = e(n));
		} else e.current = n;
	} catch (e) {
		t.__e(e, r);
	}
}
function L(e, n, r) {
	var i, a;
	if (t.unmount && t.unmount(e), (i = e.ref) && (i.current && i.current != e.__e || I(i, null, n)), (i = e.__c) != null) {
		if (i.componentWillUnmount) try {
			i.componentWillUnmount();
		} catch (e) {
			t.__e(e, n);
		}
		i.base = i.__P = null;
	}
	if (i = e.__k) for (a = 0; a < i.length; a++) i[a] && L(i[a], n, r || typeof e.type != "function");
	r || g(e.__e), e.__c = e.__ = e.__e = void 0;
}
function te(e, t, n) {
	return this.constructor(e, n);
}
function ne(n, r, i) {
	var a, o, s, c;
	r == document && (r = document.documentElement), t.__ && t.__(n, r), o = (a = typeof i == "function") ? null : i && i.__k || r.__k, s = [], c = [], M(r, n = (!a && i || r).__k = _(y, null, [n]), o || d, d, r.namespaceURI, !a && i ? [i] : o ? null : r.firstChild ? e.call(r.childNodes) : null, s, !a && i ? i : o ? o.__e : r.firstChild, a, c), P(s, n, c);
}
e = f.slice, t = { __e: function(e, t, n, r) {
	for (var i, a, o; t = t.__;) if ((i = t.__c) && !i.__) try {
		if ((a = i.constructor) && a.getDerivedStateFromError != null && (i.setState(a.getDerivedStateFromError(e)), o = i.__d), i.componentDidCatch != null && (i.componentDidCatch(e, r || {}), o = i.__d), o) return i.__E = i;
	} catch (t) {
		e = t;
	}
	throw e;
} }, n = 0, b.prototype.setState = function(e, t) {
	var n = this.__s != null && this.__s != this.state ? this.__s : this.__s = h({}, this.state);
	typeof e == "function" && (e = e(h({}, n), this.props)), e && h(n, e), e != null && this.__v && (t && this._sb.push(t), C(this));
}, b.prototype.forceUpdate = function(e) {
	this.__v && (this.__e = !0, e && this.__h.push(e), C(this));
}, b.prototype.render = y, r = [], a = typeof Promise == "function" ? Promise.prototype.then.bind(Promise.resolve()) : setTimeout, o = function(e, t) {
	return e.__v.__b - t.__v.__b;
}, w.__r = 0, s = /(PointerCapture)$|Capture$/i, c = 0, l = j(!1), u = j(!0);
// node_modules/preact/hooks/dist/hooks.module.js
var R, z, re, ie, B = 0, ae = [], V = t, H = V.__b, oe = V.__r, se = V.diffed, ce = V.__c, le = V.unmount, ue = V.__;
function de(e, t) {
	V.__h && V.__h(z, e, B || t), B = 0;
	var n = z.__H || (z.__H = {
		__: [],
		__h: []
	});
	return e >= n.__.length && n.__.push({}), n.__[e];
}
function U(e) {
	return B = 1, fe(be, e);
}
function fe(e, t, n) {
	var r = de(R++, 2);
	if (r.t = e, !r.__c && (r.__ = [n ? n(t) : be(void 0, t), function(e) {
		var t = r.__N ? r.__N[0] : r.__[0], n = r.t(t, e);
		t !== n && (r.__N = [n, r.__[1]], r.__c.setState({}));
	}], r.__c = z, !z.__f)) {
		var i = function(e, t, n) {
			if (!r.__c.__H) return !0;
			var i = r.__c.__H.__.filter(function(e) {
				return !!e.__c;
			});
			if (i.every(function(e) {
				return !e.__N;
			})) return !a || a.call(this, e, t, n);
			var o = r.__c.props !== e;
			return i.forEach(function(e) {
				if (e.__N) {
					var t = e.__[0];
					e.__ = e.__N, e.__N = void 0, t !== e.__[0] && (o = !0);
				}
			}), a && a.call(this, e, t, n) || o;
		};
		z.__f = !0;
		var a = z.shouldComponentUpdate, o = z.componentWillUpdate;
		z.componentWillUpdate = function(e, t, n) {
			if (this.__e) {
				var r = a;
				a = void 0, i(e, t, n), a = r;
			}
			o && o.call(this, e, t, n);
		}, z.shouldComponentUpdate = i;
	}
	return r.__N || r.__;
}
function W(e, t) {
	var n = de(R++, 3);
	!V.__s && ye(n.__H, t) && (n.__ = e, n.u = t, z.__H.__h.push(n));
}
function G(e) {
	return B = 5, pe(function() {
		return { current: e };
	}, []);
}
function pe(e, t) {
	var n = de(R++, 7);
	return ye(n.__H, t) && (n.__ = e(), n.__H = t, n.__h = e), n.__;
}
function me() {
	for (var e; e = ae.shift();) if (e.__P && e.__H) try {
		e.__H.__h.forEach(_e), e.__H.__h.forEach(ve), e.__H.__h = [];
	} catch (t) {
		e.__H.__h = [], V.__e(t, e.__v);
	}
}
V.__b = function(e) {
	z = null, H && H(e);
}, V.__ = function(e, t) {
	e && t.__k && t.__k.__m && (e.__m = t.__k.__m), ue && ue(e, t);
}, V.__r = function(e) {
	oe && oe(e), R = 0;
	var t = (z = e.__c).__H;
	t && (re === z ? (t.__h = [], z.__h = [], t.__.forEach(function(e) {
		e.__N && (e.__ = e.__N), e.u = e.__N = void 0;
	})) : (t.__h.forEach(_e), t.__h.forEach(ve), t.__h = [], R = 0)), re = z;
}, V.diffed = function(e) {
	se && se(e);
	var t = e.__c;
	t && t.__H && (t.__H.__h.length && (ae.push(t) !== 1 && ie === V.requestAnimationFrame || ((ie = V.requestAnimationFrame) || ge)(me)), t.__H.__.forEach(function(e) {
		e.u && (e.__H = e.u), e.u = void 0;
	})), re = z = null;
}, V.__c = function(e, t) {
	t.some(function(e) {
		try {
			e.__h.forEach(_e), e.__h = e.__h.filter(function(e) {
				return !e.__ || ve(e);
			});
		} catch (n) {
			t.some(function(e) {
				e.__h &&= [];
			}), t = [], V.__e(n, e.__v);
		}
	}), ce && ce(e, t);
}, V.unmount = function(e) {
	le && le(e);
	var t, n = e.__c;
	n && n.__H && (n.__H.__.forEach(function(e) {
		try {
			_e(e);
		} catch (e) {
			t = e;
		}
	}), n.__H = void 0, t && V.__e(t, n.__v));
};
var he = typeof requestAnimationFrame == "function";
function ge(e) {
	var t, n = function() {
		clearTimeout(r), he && cancelAnimationFrame(t), setTimeout(e);
	}, r = setTimeout(n, 35);
	he && (t = requestAnimationFrame(n));
}
function _e(e) {
	var t = z, n = e.__c;
	typeof n == "function" && (e.__c = void 0, n()), z = t;
}
function ve(e) {
	var t = z;
	e.__c = e.__(), z = t;
}
function ye(e, t) {
	return !e || e.length !== t.length || t.some(function(t, n) {
		return t !== e[n];
	});
}
function be(e, t) {
	return typeof t == "function" ? t(e) : t;
}
var xe = {
	en: {
		language: "English",
		title: "Pomona",
		surveys: "Surveys",
		newSurvey: "New survey",
		openSurvey: "Add a survey of this computer",
		close: "Close Pomona",
		closeSure: "Pomona will end. A run that is at work stops and can go on another time.",
		closed: "Pomona has ended. You can close this window.",
		closedHow: "Start it again with the command pomona app.",
		lost: "Pomona does not answer. If you ended it, start it again; otherwise this page goes on by itself.",
		noAnswer: "Pomona does not answer. If you ended it, start it again; otherwise try once more.",
		ended: "This page is of a Pomona that has ended. Go on in the page that opened when it was started again.",
		cancel: "Cancel",
		back: "Back",
		none: "No surveys yet",
		noneText: "A survey is a row of trees in photos: walk along the row, a photo at every step, then give the photos to Pomona.",
		trySample: "Try it with the sample",
		sampleText: "28 photos of two rendered trees; takes some minutes.",
		photos: (e, t) => e === 1 ? "1 photo" : `${t} photos`,
		fruits: (e, t) => e === 1 ? "1 fruit" : `${t} fruits`,
		taken: (e) => `taken ${e}`,
		corrected: "corrected since: “Bring up to date” counts and weighs again",
		states: {
			new: "not begun",
			queued: "waiting its turn",
			running: "at work",
			stopping: "stopping",
			stopped: "stopped",
			failed: "failed",
			finished: "finished",
			missing: "folder not found"
		},
		missingText: "The folder of this survey is not where it was. Put it back, or add it from its new place; what is in it is not lost.",
		left: (e) => `about ${e} left`,
		seconds: (e) => `${e} s`,
		minutes: (e) => `${e} min`,
		hours: (e, t) => `${e} h ${t} min`,
		of: (e, t) => `${e} of ${t}`,
		forget: "Take off the list",
		forgetText: "The folder and its results stay on disk.",
		stop: "Stop",
		stopNow: "Stop at once",
		stoppingText: "The step at work comes to its end first.",
		goOn: "Go on",
		again: "Bring up to date",
		unqueue: "Take out of the queue",
		byOther: "Another Pomona works on this survey, such as a command in a terminal. It can be watched here, and stopped there.",
		stages: {
			photos: "Photos",
			segment: "Fruits in photos",
			select: "Fruits that count",
			sfm: "Where the camera stood",
			scale: "Metres",
			fuse: "Fruits in space",
			second_look: "Second look",
			filter: "False fruits out",
			measure: "Sizes",
			planting: "Trees",
			dense: "Cloud of the fruits",
			scene: "Cloud of the row",
			results: "Tables and map",
			report: "Report",
			learn: "Learning"
		},
		stageStates: {
			waiting: "waiting",
			now: "at work",
			halted: "stopped here",
			done: "done",
			kept: "kept from before"
		},
		steps: {},
		progress: "Progress",
		photosTab: "Photos",
		sceneTab: "Row",
		resultTab: "Fruits in 3D",
		treesTab: "Trees",
		exportTab: "Files",
		compareTab: "Two dates",
		possible: (e, t) => e === 1 ? "1 possible fruit" : `${t} possible fruits`,
		notYet: "not looked at yet",
		photosWait: "Photos appear here when the run has read them.",
		photoOf: (e, t) => `${e}: ${t}`,
		more: (e) => `Show ${e} more`,
		sceneWait: "The row appears here as soon as the cameras have their places.",
		sceneText: (e, t) => `${e} camera places, ${t} fruits. Drag to turn, scroll to come nearer.`,
		sceneLabel: "The row in space: points, camera places and fruits. Arrow keys turn it, plus and minus change its size.",
		resultWait: "The fruits appear here when the run has come to its end.",
		viewTitle: "Report and 3D view of the survey",
		print: "Print or save as PDF",
		warnings: "What to know",
		english: "",
		log: "Log",
		failed: "The run could not go on",
		failedDo: "What was finished is kept. Mend what is said here, then go on.",
		equal: "The same without this page",
		equalCommand: "At the command line",
		equalPython: "In Python",
		copy: "Copy",
		copied: "Copied",
		folder: "Folder",
		teachTab: "Teach",
		teachText: "Where fruits are missed, or leaves are taken for fruits, show the network what fruits look like here: mark some in a few photos, and let it learn.",
		teachHow: "Choose a photo in which something is wrong. Best are two or three photos in which you mark all fruits: then what is not marked is learnt as no fruit, and one of these photos is kept aside to measure on.",
		mark: "Mark fruits",
		marksOf: (e, t) => e === 1 ? "1 mark" : `${t} marks`,
		allMarked: "all marked",
		shapes: {
			circle: "Circle",
			box: "Box"
		},
		undo: "Undo",
		deleteMark: "Delete mark",
		nearer: "Nearer",
		farther: "Farther",
		showFound: "Show what was found",
		photoBefore: "Photo before",
		photoAfter: "Photo after",
		markFirst: {
			circle: "Click on the edge of a fruit, then on the edge opposite; hidden parts count. Drag to move the photo, scroll to come nearer; click on a mark’s line to choose it.",
			box: "Click on one corner around a fruit, then on the one opposite. Drag to move the photo, scroll to come nearer; click on a mark’s line to choose it."
		},
		markSecond: {
			circle: "Now the edge opposite. Escape takes the first click back.",
			box: "Now the corner opposite. Escape takes the first click back."
		},
		markLabel: "The photo. Arrow keys move the cross, Enter sets a point, plus and minus change the size, Delete removes the chosen mark.",
		complete: "All fruits in this photo are marked.",
		completeText: "Also those that were found.",
		taught: (e, t, n, r) => `${e} in ${t}, all fruits in ${n} of these. Corrections made in the view: ${r}.`,
		learnFromThese: "Learn from these",
		learntTitle: "Before and after learning",
		learntNot: "What the network learnt was not better, so nothing was changed. Mark more fruits, or all fruits in more photos, and try again.",
		learntRows: {
			f1: "F1 of fruits in photos kept aside",
			byHand: (e) => `F1 of the ${e} of them that you marked`,
			halves: "Fruits on which two halves of the photos agree",
			detections: "Found in photos",
			fruits: "Fruits"
		},
		learntHonest: "F1 (1 is best) counts fruits that were missed and what is none. Photos kept aside are never learnt from.",
		before: "Before",
		after: "After",
		learn: "Learn from this survey",
		learnText: "The network that finds fruits learns from your marks, from fruits that many photos confirm, and from corrections made in the view; then the survey is made again. It takes some minutes more than a run. What it learnt is kept only if it finds fruits no worse.",
		learnMissing: "This needs the extra “train”: pip install 'pomona[train]'.",
		learnt: "The network has learnt from this survey.",
		files: "Take the results elsewhere",
		fileNames: {
			"report.html": "Report, as one file",
			"fruits.csv": "Fruits, for a spreadsheet",
			"trees.csv": "Trees, for a spreadsheet",
			gpkg: "Fruits, trees and row, for QGIS",
			"fruits.geojson": "Fruits on the map (GeoJSON)",
			kml: "Fruits, for Google Earth (KML)",
			laz: "Points (LAZ)",
			ply: "Points (PLY)",
			coco: "Masks (COCO)",
			colmap: "Cameras and points (COLMAP)",
			nerfstudio: "Cameras (nerfstudio)",
			metashape: "Cameras (Metashape)",
			geoparquet: "Fruits (GeoParquet)"
		},
		tree: "Tree",
		fruitsHead: "Fruits",
		between: "between",
		diameter: "Diameter",
		weight: "Weight",
		noTrees: "Fruits were not put on trees: trees are not known. Say how far apart they stand in a new survey, or run it with --trees.",
		compareText: "The same row on an earlier date: growth, what fell, what is new.",
		compareWith: "Earlier survey",
		compare: "Compare",
		compareNone: "There is no other finished survey.",
		step1: "Photos",
		step2: "What you know",
		step3: "Name and start",
		chooseFolder: "Choose a folder",
		chooseText: "The folder with the photos of the row, or two folders, one for each side. A video will do, too.",
		dropHere: "Drop photos, a folder or a video here",
		dropText: "They are copied; your own files stay as they are.",
		chooseFiles: "Choose files",
		copying: (e, t) => `Copying: ${e} of ${t}`,
		skipped: (e) => e === 1 ? "1 file is no photo and was left out" : `${e} files are no photos and were left out`,
		renamed: (e, t, n) => (e === 1 ? `1 photo has another name here, ${n}` : `${e} photos have other names here, the first ${n}`) + `: that of ${t} has characters that names of files cannot have everywhere`,
		chosen: "Chosen",
		remove: "Remove",
		secondSide: "Add the other side",
		chooseThis: "Choose this folder",
		up: "One folder up",
		home: "Home",
		roots: "Where to look",
		emptyFolder: "Nothing to choose in here.",
		videos: (e) => e === 1 ? "1 video" : `${e} videos`,
		aSurvey: "survey",
		checking: "Looking at the photos…",
		checkGood: "The photos look good.",
		checkOf: (e, t) => `${e} of ${t} photos were looked at.`,
		checkSides: (e) => `Sides: ${e}`,
		checkVideo: "Frames of the video are chosen when the run begins.",
		checkNoPositions: "The photos do not say where they were taken.",
		checkPositions: (e) => `${e} photos say where they were taken.`,
		problems: {
			blurred: "Blurred",
			dark: "Too dark",
			bright: "Too bright",
			gap: "Too far from the photo before"
		},
		problemDo: {
			blurred: "Hold the camera still or use a shorter exposure. A few such photos do no harm.",
			dark: "Expose longer, or wait for better light.",
			bright: "Do not take photos against the sun.",
			gap: "Take a photo at every step: each should show two thirds of the one before. Gaps tear the row apart; take the missing photos if you can."
		},
		fruit: "Which fruit?",
		fruitOther: "Another, or not sure",
		fruitNames: {
			apple: "Apples",
			pear: "Pears",
			orange: "Oranges",
			mandarin: "Mandarins",
			lemon: "Lemons",
			peach: "Peaches",
			plum: "Plums",
			cherry: "Cherries",
			mango: "Mangoes",
			kiwi: "Kiwis",
			tomato: "Tomatoes"
		},
		fruitText: "Says how heavy fruits are for their size, and how large they usually are.",
		size: "Usual diameter",
		sizeText: (e) => `In millimetres; ${e} if you say nothing. It sets the scale only where nothing better does.`,
		noNumber: (e) => `'${e}' is no number: write one such as 75 or 2.5`,
		metres: "What gives the scale?",
		metresKinds: {
			gnss: "Nothing special",
			markers: "Markers whose places I measured",
			"scale-bar": "Two markers at a known distance",
			nothing: "Nothing, and not the places in the photos either"
		},
		metresText: {
			gnss: "Places that the camera noted in the photos are used, if there are any; otherwise sizes and distances rest on the usual diameter.",
			markers: "Best: metres and places to a few millimetres. The table has the columns id, x, y, z.",
			"scale-bar": "Good: true metres, without a place on the map.",
			nothing: "Sizes and distances rest on the usual diameter: good for counting."
		},
		markersFile: "Table of the markers",
		barOne: "Number of one marker",
		barOther: "Number of the other",
		barLength: "Metres between their centres",
		sides: "Sides of the row",
		sidesAuto: "As folders or names say",
		sidesOne: "All photos are of one side",
		spacing: "Distance of the trees in the row",
		spacingText: "In metres. Leave it empty and trees are where fruits gather.",
		learnToo: "Learn from the photos, too",
		learnTooText: "Takes longer; finds more where the fruits look unlike those the network knows.",
		name: "Name of the row",
		nameText: (e) => `The results go to ${e}.`,
		namePlaceholder: "Row 12, August",
		start: "Start",
		problem: "This does not work",
		markersPicture: "Printed markers stand along the row",
		theme: "Light or dark"
	},
	de: {
		language: "Deutsch",
		title: "Pomona",
		surveys: "Aufnahmen",
		newSurvey: "Neue Aufnahme",
		openSurvey: "Aufnahme auf diesem Rechner hinzufügen",
		close: "Pomona beenden",
		closeSure: "Pomona wird beendet. Ein laufender Durchgang hält an und kann später weitergehen.",
		closed: "Pomona ist beendet. Dieses Fenster kann geschlossen werden.",
		closedHow: "Neu starten mit dem Befehl pomona app.",
		lost: "Pomona antwortet nicht. Wurde es beendet, bitte neu starten; sonst geht es von selbst weiter.",
		noAnswer: "Pomona antwortet nicht. Wurde es beendet, bitte neu starten; sonst bitte noch einmal versuchen.",
		ended: "Das Pomona dieser Seite wurde beendet. Weiter geht es auf der Seite, die sich beim neuen Start geöffnet hat.",
		cancel: "Abbrechen",
		back: "Zurück",
		none: "Noch keine Aufnahmen",
		noneText: "Eine Aufnahme ist eine Baumreihe in Fotos: die Reihe entlanggehen, bei jedem Schritt ein Foto, dann die Fotos an Pomona geben.",
		trySample: "Mit dem Beispiel ausprobieren",
		sampleText: "28 Fotos zweier gerechneter Bäume; dauert einige Minuten.",
		photos: (e, t) => e === 1 ? "1 Foto" : `${t} Fotos`,
		fruits: (e, t) => e === 1 ? "1 Frucht" : `${t} Früchte`,
		taken: (e) => `aufgenommen ${e}`,
		corrected: "seither korrigiert: „Auf den neuesten Stand“ zählt und wiegt neu",
		states: {
			new: "nicht begonnen",
			queued: "wartet",
			running: "läuft",
			stopping: "hält an",
			stopped: "angehalten",
			failed: "fehlgeschlagen",
			finished: "fertig",
			missing: "Ordner nicht gefunden"
		},
		missingText: "Der Ordner dieser Aufnahme ist nicht mehr an seinem Platz. Bitte zurücklegen oder vom neuen Platz hinzufügen; verloren ist nichts.",
		left: (e) => `noch etwa ${e}`,
		seconds: (e) => `${e} s`,
		minutes: (e) => `${e} min`,
		hours: (e, t) => `${e} h ${t} min`,
		of: (e, t) => `${e} von ${t}`,
		forget: "Von der Liste nehmen",
		forgetText: "Der Ordner mit den Ergebnissen bleibt auf der Platte.",
		stop: "Anhalten",
		stopNow: "Sofort anhalten",
		stoppingText: "Der laufende Schritt wird erst beendet.",
		goOn: "Weiter",
		again: "Auf den neuesten Stand",
		unqueue: "Aus der Warteschlange nehmen",
		byOther: "Ein anderes Pomona arbeitet an dieser Aufnahme, etwa ein Befehl in einem Terminal. Hier kann man zusehen, anhalten nur dort.",
		stages: {
			photos: "Fotos",
			segment: "Früchte in den Fotos",
			select: "Früchte, die zählen",
			sfm: "Standorte der Kamera",
			scale: "Meter",
			fuse: "Früchte im Raum",
			second_look: "Zweiter Blick",
			filter: "Falsche Früchte hinaus",
			measure: "Größen",
			planting: "Bäume",
			dense: "Punkte der Früchte",
			scene: "Punkte der Reihe",
			results: "Tabellen und Karte",
			report: "Bericht",
			learn: "Lernen"
		},
		stageStates: {
			waiting: "wartet",
			now: "läuft",
			halted: "hier beendet",
			done: "fertig",
			kept: "von vorher"
		},
		steps: {
			"Reading photo headers": "Kopfdaten der Fotos lesen",
			"looking at the photos": "Fotos ansehen",
			"looking for changes in photos": "Fotos auf Änderungen prüfen",
			"looking for the size of the fruits": "nach der Größe der Früchte sehen",
			segmenting: "Früchte in Fotos suchen",
			"reading the detections given": "gegebene Masken lesen",
			"reading the cameras given": "gegebene Kameras lesen",
			Features: "Merkmale finden",
			Matching: "Fotos vergleichen",
			"Matching what overlaps": "überlappende Fotos vergleichen",
			"Matching what holds photos": "verbindende Fotos vergleichen",
			"Joining pieces": "Teile verbinden",
			"Placing photos, incremental": "Fotos an ihren Platz setzen",
			"Placing photos, global": "Fotos an ihren Platz setzen",
			"Looking for markers": "Marker suchen",
			"Refining cameras on the markers": "Kameras an den Markern ausrichten",
			"Adjusting cameras together": "Kameras gemeinsam ausgleichen",
			"Adjusting cameras on fruits": "Kameras an den Früchten ausgleichen",
			"Aligning sides by their fruits": "Seiten an ihren Früchten ausrichten",
			fuse: "Früchte zusammenführen",
			"looking again": "noch einmal hinsehen",
			"filtering false positives": "falsche Früchte aussortieren",
			measure: "messen",
			dense: "Punkte berechnen",
			scene: "Punkte der Reihe berechnen",
			"labelling photos": "Fotos beschriften",
			training: "lernen",
			"writing tables, map and cloud": "Tabellen, Karte und Punkte schreiben",
			"cutting crops out of photos": "Ausschnitte schneiden",
			"drawing fruits into photos": "Früchte in Fotos zeichnen",
			report: "Bericht schreiben"
		},
		progress: "Fortschritt",
		photosTab: "Fotos",
		sceneTab: "Reihe",
		resultTab: "Früchte in 3D",
		treesTab: "Bäume",
		exportTab: "Dateien",
		compareTab: "Zwei Termine",
		possible: (e, t) => e === 1 ? "1 mögliche Frucht" : `${t} mögliche Früchte`,
		notYet: "noch nicht angesehen",
		photosWait: "Die Fotos erscheinen hier, sobald sie gelesen sind.",
		photoOf: (e, t) => `${e}: ${t}`,
		more: (e) => `${e} weitere zeigen`,
		sceneWait: "Die Reihe erscheint hier, sobald die Standorte der Kamera bekannt sind.",
		sceneText: (e, t) => `${e} Standorte der Kamera, ${t} Früchte. Ziehen dreht, Rollen holt näher.`,
		sceneLabel: "Die Reihe im Raum: Punkte, Standorte der Kamera und Früchte. Pfeiltasten drehen sie, Plus und Minus ändern die Größe.",
		resultWait: "Die Früchte erscheinen hier, wenn der Durchgang zu Ende ist.",
		viewTitle: "Bericht und 3D-Ansicht der Aufnahme",
		print: "Drucken oder als PDF sichern",
		warnings: "Gut zu wissen",
		english: "Warnungen und Fehlermeldungen von Pomona selbst sind englisch.",
		log: "Protokoll",
		failed: "Der Durchgang konnte nicht weitergehen",
		failedDo: "Was fertig ist, bleibt. Bitte beheben, was hier steht, dann weitermachen.",
		equal: "Dasselbe ohne diese Seite",
		equalCommand: "In der Befehlszeile",
		equalPython: "In Python",
		copy: "Kopieren",
		copied: "Kopiert",
		folder: "Ordner",
		teachTab: "Beibringen",
		teachText: "Wo Früchte übersehen oder Blätter für Früchte gehalten werden, hilft es, dem Netz zu zeigen, wie Früchte hier aussehen: einige in wenigen Fotos markieren und es lernen lassen.",
		teachHow: "Ein Foto wählen, in dem etwas nicht stimmt. Am besten sind zwei oder drei Fotos, in denen alle Früchte markiert sind: Was dort nicht markiert ist, wird als keine Frucht gelernt, und eines dieser Fotos bleibt zum Messen beiseite.",
		mark: "Früchte markieren",
		marksOf: (e, t) => e === 1 ? "1 Markierung" : `${t} Markierungen`,
		allMarked: "alle markiert",
		shapes: {
			circle: "Kreis",
			box: "Kasten"
		},
		undo: "Rückgängig",
		deleteMark: "Markierung löschen",
		nearer: "Näher",
		farther: "Weiter weg",
		showFound: "Gefundenes zeigen",
		photoBefore: "Voriges Foto",
		photoAfter: "Nächstes Foto",
		markFirst: {
			circle: "Auf den Rand einer Frucht klicken, dann auf den Rand gegenüber; verdeckte Teile zählen mit. Ziehen verschiebt das Foto, Rollen holt näher; ein Klick auf die Linie wählt eine Markierung.",
			box: "Auf eine Ecke um eine Frucht klicken, dann auf die gegenüber. Ziehen verschiebt das Foto, Rollen holt näher; ein Klick auf die Linie wählt eine Markierung."
		},
		markSecond: {
			circle: "Jetzt der Rand gegenüber. Escape nimmt den ersten Klick zurück.",
			box: "Jetzt die Ecke gegenüber. Escape nimmt den ersten Klick zurück."
		},
		markLabel: "Das Foto. Pfeiltasten bewegen das Kreuz, Enter setzt einen Punkt, Plus und Minus ändern die Größe, Entf löscht die gewählte Markierung.",
		complete: "Alle Früchte in diesem Foto sind markiert.",
		completeText: "Auch die gefundenen.",
		taught: (e, t, n, r) => `${e} in ${t}, in ${n} davon alle Früchte. Korrekturen in der Ansicht: ${r}.`,
		learnFromThese: "Daraus lernen",
		learntTitle: "Vor und nach dem Lernen",
		learntNot: "Das Gelernte war nicht besser, deshalb wurde nichts geändert. Mehr Früchte markieren, oder alle Früchte in mehr Fotos, und noch einmal versuchen.",
		learntRows: {
			f1: "F1 der Früchte in beiseite gelegten Fotos",
			byHand: (e) => `F1 der ${e} selbst markierten davon`,
			halves: "Früchte, in denen zwei Hälften der Fotos übereinstimmen",
			detections: "In Fotos gefunden",
			fruits: "Früchte"
		},
		learntHonest: "F1 (1 ist am besten) zählt Übersehenes und was keine Frucht ist. Aus beiseite gelegten Fotos wird nie gelernt.",
		before: "Vorher",
		after: "Nachher",
		learn: "Aus dieser Aufnahme lernen",
		learnText: "Das Netz, das Früchte findet, lernt aus Markierungen, aus Früchten, die viele Fotos bestätigen, und aus Korrekturen in der Ansicht; dann wird die Aufnahme neu gerechnet. Das dauert einige Minuten länger als ein Durchgang. Das Gelernte bleibt nur, wenn es Früchte nicht schlechter findet.",
		learnMissing: "Dazu fehlt die Erweiterung „train“: pip install 'pomona[train]'.",
		learnt: "Das Netz hat aus dieser Aufnahme gelernt.",
		files: "Ergebnisse mitnehmen",
		fileNames: {
			"report.html": "Bericht, eine Datei",
			"fruits.csv": "Früchte, für die Tabellenkalkulation",
			"trees.csv": "Bäume, für die Tabellenkalkulation",
			gpkg: "Früchte, Bäume und Reihe, für QGIS",
			"fruits.geojson": "Früchte auf der Karte (GeoJSON)",
			kml: "Früchte, für Google Earth (KML)",
			laz: "Punkte (LAZ)",
			ply: "Punkte (PLY)",
			coco: "Masken (COCO)",
			colmap: "Kameras und Punkte (COLMAP)",
			nerfstudio: "Kameras (nerfstudio)",
			metashape: "Kameras (Metashape)",
			geoparquet: "Früchte (GeoParquet)"
		},
		tree: "Baum",
		fruitsHead: "Früchte",
		between: "zwischen",
		diameter: "Durchmesser",
		weight: "Gewicht",
		noTrees: "Die Früchte sind keinen Bäumen zugeordnet: Bäume sind nicht bekannt. In einer neuen Aufnahme den Baumabstand angeben, oder --trees verwenden.",
		compareText: "Dieselbe Reihe an einem früheren Tag: Wachstum, was fiel, was neu ist.",
		compareWith: "Frühere Aufnahme",
		compare: "Vergleichen",
		compareNone: "Es gibt keine andere fertige Aufnahme.",
		step1: "Fotos",
		step2: "Was bekannt ist",
		step3: "Name und Start",
		chooseFolder: "Ordner wählen",
		chooseText: "Der Ordner mit den Fotos der Reihe, oder zwei Ordner, einer für jede Seite. Auch ein Video geht.",
		dropHere: "Fotos, einen Ordner oder ein Video hierher ziehen",
		dropText: "Sie werden kopiert; die eigenen Dateien bleiben, wie sie sind.",
		chooseFiles: "Dateien wählen",
		copying: (e, t) => `Kopiert: ${e} von ${t}`,
		skipped: (e) => e === 1 ? "1 Datei ist kein Foto und blieb weg" : `${e} Dateien sind keine Fotos und blieben weg`,
		renamed: (e, t, n) => (e === 1 ? `1 Foto heißt hier anders, ${n}` : `${e} Fotos heißen hier anders, das erste ${n}`) + `: in ${t} sind Zeichen, die Dateinamen nicht überall haben können`,
		chosen: "Gewählt",
		remove: "Entfernen",
		secondSide: "Die andere Seite dazu",
		chooseThis: "Diesen Ordner wählen",
		up: "Einen Ordner höher",
		home: "Persönlicher Ordner",
		roots: "Wo gesucht wird",
		emptyFolder: "Hier gibt es nichts zu wählen.",
		videos: (e) => e === 1 ? "1 Video" : `${e} Videos`,
		aSurvey: "Aufnahme",
		checking: "Die Fotos werden angesehen…",
		checkGood: "Die Fotos sehen gut aus.",
		checkOf: (e, t) => `${e} von ${t} Fotos wurden angesehen.`,
		checkSides: (e) => `Seiten: ${e}`,
		checkVideo: "Bilder des Videos werden gewählt, wenn der Durchgang beginnt.",
		checkNoPositions: "Die Fotos sagen nicht, wo sie aufgenommen sind.",
		checkPositions: (e) => `${e} Fotos sagen, wo sie aufgenommen sind.`,
		problems: {
			blurred: "Unscharf",
			dark: "Zu dunkel",
			bright: "Zu hell",
			gap: "Zu weit vom Foto davor"
		},
		problemDo: {
			blurred: "Kamera ruhig halten oder kürzer belichten. Einige wenige schaden nicht.",
			dark: "Länger belichten oder auf besseres Licht warten.",
			bright: "Nicht gegen die Sonne fotografieren.",
			gap: "Bei jedem Schritt ein Foto: jedes sollte zwei Drittel des vorigen zeigen. Lücken reißen die Reihe auseinander; fehlende Fotos möglichst nachholen."
		},
		fruit: "Welche Frucht?",
		fruitOther: "Eine andere, oder unsicher",
		fruitNames: {
			apple: "Äpfel",
			pear: "Birnen",
			orange: "Orangen",
			mandarin: "Mandarinen",
			lemon: "Zitronen",
			peach: "Pfirsiche",
			plum: "Pflaumen",
			cherry: "Kirschen",
			mango: "Mangos",
			kiwi: "Kiwis",
			tomato: "Tomaten"
		},
		fruitText: "Sagt, wie schwer Früchte für ihre Größe sind, und wie groß meistens.",
		size: "Üblicher Durchmesser",
		sizeText: (e) => `In Millimetern; ${e}, wenn nichts angegeben ist. Bestimmt den Maßstab nur, wo nichts Besseres da ist.`,
		noNumber: (e) => `„${e}“ ist keine Zahl: zum Beispiel 75 oder 2,5 schreiben`,
		metres: "Was gibt den Maßstab?",
		metresKinds: {
			gnss: "Nichts Besonderes",
			markers: "Marken, deren Orte gemessen sind",
			"scale-bar": "Zwei Marken mit bekanntem Abstand",
			nothing: "Nichts, auch nicht die Orte in den Fotos"
		},
		metresText: {
			gnss: "Orte, die die Kamera in den Fotos vermerkt hat, werden genutzt, wenn es welche gibt; sonst beruhen Größen und Abstände auf dem üblichen Durchmesser.",
			markers: "Am besten: Meter und Orte auf einige Millimeter. Die Tabelle hat die Spalten id, x, y, z.",
			"scale-bar": "Gut: wahre Meter, ohne Ort auf der Karte.",
			nothing: "Größen und Abstände beruhen auf dem üblichen Durchmesser: gut zum Zählen."
		},
		markersFile: "Tabelle der Marken",
		barOne: "Nummer der einen Marke",
		barOther: "Nummer der anderen",
		barLength: "Meter zwischen ihren Mitten",
		sides: "Seiten der Reihe",
		sidesAuto: "Wie Ordner oder Namen der Fotos sagen",
		sidesOne: "Alle Fotos sind von einer Seite",
		spacing: "Abstand der Bäume in der Reihe",
		spacingText: "In Metern. Bleibt es leer, stehen Bäume da, wo sich Früchte sammeln.",
		learnToo: "Auch aus den Fotos lernen",
		learnTooText: "Dauert länger; findet mehr, wo Früchte anders aussehen als die, die das Netz kennt.",
		name: "Name der Reihe",
		nameText: (e) => `Die Ergebnisse kommen nach ${e}.`,
		namePlaceholder: "Reihe 12, August",
		start: "Starten",
		problem: "So geht es nicht",
		markersPicture: "Gedruckte Marken stehen entlang der Reihe",
		theme: "Hell oder dunkel"
	}
}, Se = "pomona-language";
function Ce(e) {
	return e.map((e) => e.split("-")[0]).find((e) => e in xe) ?? "en";
}
var we = Ce([localStorage.getItem(Se) ?? "", ...navigator.languages]);
function Te(e) {
	we = e, localStorage.setItem(Se, e), document.documentElement.lang = e;
}
function Ee() {
	return we;
}
function K() {
	return xe[we];
}
function De() {
	return navigator.languages.find((e) => e.split("-")[0] === we) ?? we;
}
function q(e, t = 0) {
	return new Intl.NumberFormat(De(), {
		minimumFractionDigits: t,
		maximumFractionDigits: t
	}).format(e);
}
function Oe(e) {
	return new Intl.DateTimeFormat(De(), {
		dateStyle: "medium",
		timeZone: e.length === 10 ? "UTC" : void 0
	}).format(new Date(e));
}
function ke(e) {
	let t = K();
	if (e < 55) return t.seconds(Math.max(1, e < 10 ? Math.ceil(e) : Math.round(e / 5) * 5));
	let n = Math.round(e / 60);
	return n < 60 ? t.minutes(n) : t.hours(Math.floor(n / 60), n % 60);
}
function Ae(e) {
	let [, t, n] = /^(.*?)( \(.*)?$/.exec(e);
	return `${K().steps[t] ?? t}${n ?? ""}`;
}
// src/app/server.ts
var je = "no answer";
async function Me(e, t) {
	try {
		return await fetch(`api/${e}`, t);
	} catch {
		throw Error(je);
	}
}
async function Ne(e) {
	if (e.ok) return e.status === 204 ? void 0 : await e.json();
	let t = await e.text(), n = t;
	try {
		n = JSON.parse(t).message;
	} catch {}
	throw Error(n || `${e.status}`);
}
async function J(e) {
	return Ne(await Me(e));
}
async function Y(e, t = {}) {
	return Ne(await Me(e, {
		method: "POST",
		headers: { "Content-Type": "application/json" },
		body: JSON.stringify(t)
	}));
}
async function Pe(e) {
	let t = await Me(e);
	t.ok || await Ne(t);
	let n = Fe(t.headers.get("Content-Disposition") ?? ""), r = document.createElement("a");
	r.href = URL.createObjectURL(await t.blob()), r.download = n, r.click(), setTimeout(() => URL.revokeObjectURL(r.href), 6e4);
}
function Fe(e) {
	let t = /filename\*=utf-8''([^;]+)/i.exec(e)?.[1];
	return t ? decodeURIComponent(t) : /filename="?([^";]+)/.exec(e)?.[1] ?? "pomona";
}
function Ie(e, t, n) {
	return new Promise((r, i) => {
		let a = new XMLHttpRequest();
		a.open("PUT", `api/${e}`), a.upload.onprogress = (e) => n(e.loaded), a.onerror = () => i(/* @__PURE__ */ Error(je)), a.onload = () => {
			try {
				let e = JSON.parse(a.responseText);
				a.status === 200 ? r(e) : i(Error(e.message));
			} catch {
				i(Error(a.responseText || String(a.status)));
			}
		}, a.send(t);
	});
}
function Le(e, t) {
	let n = new EventSource("api/events");
	return n.onmessage = (n) => {
		t("yes"), e(JSON.parse(n.data));
	}, n.onerror = () => t(n.readyState === EventSource.CLOSED ? "ended" : "no"), () => n.close();
}
// node_modules/preact/jsx-runtime/dist/jsxRuntime.module.js
var Re = 0;
Array.isArray;
function X(e, n, r, i, a, o) {
	n ||= {};
	var s, c, l = n;
	if ("ref" in l) for (c in l = {}, n) c == "ref" ? s = n[c] : l[c] = n[c];
	var u = {
		type: e,
		props: l,
		key: r,
		ref: s,
		__k: null,
		__: null,
		__b: 0,
		__e: null,
		__c: null,
		constructor: void 0,
		__v: --Re,
		__i: -1,
		__u: 0,
		__source: a,
		__self: o
	};
	if (typeof e == "function" && (s = e.defaultProps)) for (c in s) l[c] === void 0 && (l[c] = s[c]);
	return t.vnode && t.vnode(u), u;
}
// src/app/parts.tsx
function ze({ text: e }) {
	return /* @__PURE__ */ X(y, { children: e.split("`").map((e, t) => t % 2 ? /* @__PURE__ */ X("code", { children: e }, t) : e) });
}
function Z({ text: e, title: t }) {
	return /* @__PURE__ */ X("div", {
		class: "problem",
		role: "alert",
		children: [/* @__PURE__ */ X("strong", { children: t ?? K().problem }), /* @__PURE__ */ X("p", { children: /* @__PURE__ */ X(ze, { text: e === "no answer" ? K().noAnswer : e }) })]
	});
}
function Q({ onDo: e, class: t, disabled: n, children: r }) {
	let [i, a] = U(!1), [o, s] = U(""), c = G(!0);
	return W(() => () => void (c.current = !1), []), /* @__PURE__ */ X(y, { children: [/* @__PURE__ */ X("button", {
		type: "button",
		class: t,
		disabled: i || n,
		onClick: async () => {
			a(!0), s("");
			try {
				await e();
			} catch (e) {
				c.current && s(e.message);
			}
			c.current && a(!1);
		},
		children: r
	}), o && /* @__PURE__ */ X(Z, { text: o })] });
}
function Be({ title: e, onClose: t, wide: n, children: r }) {
	let i = G(null), a = G(!0);
	return W(() => {
		let e = i.current;
		return e.showModal(), () => {
			a.current = !1, e.close();
		};
	}, []), /* @__PURE__ */ X("dialog", {
		ref: i,
		class: n ? "wide" : void 0,
		"aria-label": e,
		onClose: () => a.current && t(),
		children: [/* @__PURE__ */ X("div", {
			class: "bar",
			children: [/* @__PURE__ */ X("h2", { children: e }), /* @__PURE__ */ X("button", {
				type: "button",
				class: "plain",
				"aria-label": K().cancel,
				onClick: t,
				children: "×"
			})]
		}), r]
	});
}
function $({ text: e }) {
	let [t, n] = U(!1);
	return /* @__PURE__ */ X("div", {
		class: "copyable",
		children: [/* @__PURE__ */ X("pre", {
			tabIndex: 0,
			children: e
		}), /* @__PURE__ */ X("button", {
			type: "button",
			onClick: async () => {
				await navigator.clipboard.writeText(e), n(!0);
			},
			children: t ? K().copied : K().copy
		})]
	});
}
// src/app/chooser.tsx
function Ve(e) {
	let t = K();
	return [e.photos ? t.photos(e.photos, q(e.photos)) : "", e.videos ? t.videos(e.videos) : ""].filter(Boolean).join(", ");
}
function He({ title: e, kind: t, start: n, roots: r, onChoose: i, onClose: a }) {
	let o = K(), [s, c] = U(null), [l, u] = U(""), d = async (e) => {
		try {
			c(await J(`folders?path=${encodeURIComponent(e)}${t === "survey" ? "" : `&files=${t}`}`)), u("");
		} catch (t) {
			u(t.message), e !== r[0] && !s && await d(r[0]);
		}
	};
	W(() => void d(n), []);
	let f = G(null);
	W(() => {
		if (document.activeElement !== document.body) return;
		let e = f.current?.closest("dialog");
		[
			".places button",
			".foot button",
			".bar button:enabled:not(.plain)"
		].map((t) => e?.querySelector(t)).find(Boolean)?.focus();
	}, [s]);
	let p = (e) => !e.isFolder || t === "survey" && e.isSurvey ? i(e.path) : void d(e.path);
	return /* @__PURE__ */ X(Be, {
		title: e,
		onClose: a,
		children: [
			s && /* @__PURE__ */ X("div", {
				class: "bar",
				children: [
					/* @__PURE__ */ X("select", {
						"aria-label": o.roots,
						value: r.filter((e) => s.path.startsWith(e)).sort((e, t) => t.length - e.length)[0],
						onChange: (e) => d(e.currentTarget.value),
						children: r.map((e, t) => /* @__PURE__ */ X("option", {
							value: e,
							children: t ? e : o.home
						}, e))
					}),
					/* @__PURE__ */ X("button", {
						type: "button",
						disabled: !s.parent,
						onClick: () => d(s.parent),
						children: o.up
					}),
					/* @__PURE__ */ X("span", {
						class: "path",
						children: s.path
					})
				]
			}),
			l && /* @__PURE__ */ X(Z, { text: l }),
			/* @__PURE__ */ X("ul", {
				class: "places",
				ref: f,
				children: s?.places.map((e) => /* @__PURE__ */ X("li", { children: /* @__PURE__ */ X("button", {
					type: "button",
					onClick: () => p(e),
					children: [
						/* @__PURE__ */ X("svg", {
							viewBox: "0 0 16 16",
							"aria-hidden": "true",
							children: e.isFolder ? /* @__PURE__ */ X("path", { d: "M1 3h5l2 2h7v9H1z" }) : /* @__PURE__ */ X("path", { d: "M3 1h7l3 3v11H3zM10 1v3h3" })
						}),
						/* @__PURE__ */ X("span", { children: e.name }),
						/* @__PURE__ */ X("span", {
							class: "soft",
							children: e.isSurvey ? o.aSurvey : Ve(e)
						})
					]
				}) }, e.path))
			}),
			s && !s.places.length && /* @__PURE__ */ X("p", {
				class: "soft inside",
				children: Ve(s) || o.emptyFolder
			}),
			t === "photos" && s && /* @__PURE__ */ X("div", {
				class: "bar foot",
				children: [/* @__PURE__ */ X("span", {
					class: "soft",
					children: Ve(s)
				}), /* @__PURE__ */ X("button", {
					type: "button",
					class: "main",
					onClick: () => i(s.path),
					children: o.chooseThis
				})]
			})
		]
	});
}
// src/app/list.tsx
function Ue(e) {
	location.hash = e;
}
function We(e) {
	let t = K();
	if (e.fruits === null) return "";
	let n = t.fruitNames[e.fruit];
	return n && e.fruits !== 1 ? `${q(e.fruits)} ${n}` : t.fruits(e.fruits, q(e.fruits));
}
function Ge(e) {
	if (e.state !== "running" || !e.run) return null;
	let { stages: t, done: n, total: r } = e.run;
	return (t.filter((e) => e.state === "done" || e.state === "kept").length + (r ? n / r : 0)) / t.length;
}
function Ke({ survey: e }) {
	let t = K(), n = Ge(e), r = e.photos ? Math.floor(e.photos / 4) : 0;
	return /* @__PURE__ */ X("li", { children: /* @__PURE__ */ X("a", {
		class: "card",
		href: `#/survey/${e.id}`,
		children: [/* @__PURE__ */ X("span", {
			class: "picture",
			children: e.photos ? /* @__PURE__ */ X("img", {
				src: `api/surveys/${e.id}/photos/${r}/320.jpg?${e.version}`,
				alt: "",
				loading: "lazy",
				onError: (e) => e.currentTarget.hidden = !0
			}) : null
		}), /* @__PURE__ */ X("span", {
			class: "about",
			children: [
				/* @__PURE__ */ X("strong", { children: e.name }),
				/* @__PURE__ */ X("span", {
					class: `state ${e.state}`,
					children: t.states[e.state]
				}),
				n !== null && /* @__PURE__ */ X("progress", {
					value: n,
					max: 1,
					"aria-label": t.progress
				}),
				e.state === "running" && e.run?.leftS != null && /* @__PURE__ */ X("span", {
					class: "soft",
					children: t.left(ke(e.run.leftS))
				}),
				e.fruits !== null && /* @__PURE__ */ X("span", {
					class: "figure",
					children: We(e)
				}),
				/* @__PURE__ */ X("span", {
					class: "soft",
					children: [e.photos === null ? "" : t.photos(e.photos, q(e.photos)), e.day ? t.taken(Oe(e.day)) : Oe(e.changed)].filter(Boolean).join(" · ")
				})
			]
		})]
	}) });
}
function qe({ everything: e }) {
	let t = K(), [n, r] = U(!1), [i, a] = U(""), o = async (e) => {
		r(!1), a("");
		try {
			Ue(`/survey/${await Y("surveys/add", { folder: e })}`);
		} catch (e) {
			a(e.message);
		}
	}, s = /* @__PURE__ */ X(Q, {
		onDo: async () => Ue(`/survey/${await Y("surveys/sample")}`),
		children: t.trySample
	});
	return /* @__PURE__ */ X("main", { children: [
		/* @__PURE__ */ X("div", {
			class: "head",
			children: [/* @__PURE__ */ X("h1", { children: t.surveys }), /* @__PURE__ */ X("span", {
				class: "end",
				children: [/* @__PURE__ */ X("button", {
					type: "button",
					onClick: () => r(!0),
					children: t.openSurvey
				}), /* @__PURE__ */ X("a", {
					class: "button main",
					href: "#/new",
					children: t.newSurvey
				})]
			})]
		}),
		i && /* @__PURE__ */ X(Z, { text: i }),
		e.surveys.length ? /* @__PURE__ */ X("ul", {
			class: "cards",
			children: e.surveys.map((e) => /* @__PURE__ */ X(Ke, { survey: e }, e.id))
		}) : /* @__PURE__ */ X("div", {
			class: "sheet empty",
			children: [
				/* @__PURE__ */ X("h2", { children: t.none }),
				/* @__PURE__ */ X("p", { children: t.noneText }),
				/* @__PURE__ */ X("p", {
					class: "line",
					children: [
						/* @__PURE__ */ X("a", {
							class: "button main",
							href: "#/new",
							children: t.newSurvey
						}),
						s,
						/* @__PURE__ */ X("span", {
							class: "soft",
							children: t.sampleText
						})
					]
				})
			]
		}),
		n && /* @__PURE__ */ X(He, {
			title: t.openSurvey,
			kind: "survey",
			start: e.facts.surveysFolder,
			roots: e.facts.roots,
			onClose: () => r(!1),
			onChoose: o
		})
	] });
}
// src/app/names.ts
var Je = /[\x00-\x1f/\\:*?"<>|]+/g;
function Ye(e) {
	return e.trim().replace(Je, "-").replace(/^[ .-]+|[ .-]+$/g, "").slice(0, 100);
}
var Xe = 150;
function Ze(e) {
	return e.split("/").map((e) => e.replace(Je, "-").trim()).map((e) => e.length > Xe ? e.slice(-140).trim() : e).join("/");
}
// src/app/dropping.ts
var Qe = /\.(jpe?g|jpe|png|tiff?|hei[cf]|webp|bmp|mp4|mov|m4v|avi|mkv|webm|mts|m2ts|mpg|mpeg|3gp)$/i;
function $e(e) {
	return Qe.test(e) && !e.split("/").some((e) => e.startsWith("."));
}
async function et(e, t) {
	let n = t + e.name;
	if (e.isFile) return [{
		name: n,
		file: await new Promise((t, n) => e.file(t, n))
	}];
	let r = e.createReader(), i = [];
	for (;;) {
		let e = await new Promise((e, t) => r.readEntries(e, t));
		if (!e.length) return i;
		for (let t of e) i.push(...await et(t, `${n}/`));
	}
}
async function tt(e) {
	let t = [...e.items].map((e) => e.webkitGetAsEntry()).filter((e) => e !== null);
	return (await Promise.all(t.map((e) => et(e, "")))).flat();
}
function nt(e) {
	return [...e].map((e) => ({
		name: e.webkitRelativePath || e.name,
		file: e
	}));
}
function rt(e) {
	let t = e[0]?.name.split("/")[0];
	return e.length > 0 && e.every(({ name: e }) => e.includes("/") && e.split("/")[0] === t) ? rt(e.map(({ name: e, file: n }) => ({
		name: e.slice(t.length + 1),
		file: n
	}))) : e;
}
function it(e) {
	let t = new Set(e.map(({ name: e }) => e).filter((e) => Ze(e) === e));
	return e.map(({ name: e, file: n }) => {
		let r = Ze(e);
		if (r !== e) {
			for (; t.has(r);) r = r.replace(/(\.[^./]*)$/, "-$1");
			t.add(r);
		}
		return {
			name: r,
			file: n
		};
	});
}
async function at(e, t) {
	let n = await Y("drops"), r = e.reduce((e, { file: t }) => e + t.size, 0), i = "", a = 0;
	for (let [o, { name: s, file: c }] of e.entries()) i = await Ie(`drops/${n}/${s.split("/").map(encodeURIComponent).join("/")}`, c, (e) => t(o, a + e, r)), a += c.size, t(o + 1, a, r);
	let o = e.length === 1 ? e[0].name : "";
	return /\.(jpe?g|jpe|png|tiff?|hei[cf]|webp|bmp)$/i.test(o) || !o ? i : `${i}/${o}`;
}
// src/app/numbers.ts
function ot(e, t) {
	let n = e.trim().replace(RegExp(`\\s*${t}$`, "i"), "");
	return e.trim() ? /^\d+([.,]\d*)?$|^[.,]\d+$/.test(n) ? Number(n.replace(",", ".")) : NaN : null;
}
// src/app/new.tsx
var st = [
	"gnss",
	"markers",
	"scale-bar",
	"nothing"
];
function ct(e) {
	return e.split(/[/\\]/).filter(Boolean).pop() ?? e;
}
function lt({ check: e }) {
	let t = K(), n = [
		"gap",
		"blurred",
		"dark",
		"bright"
	], r = [
		e.photos ? t.photos(e.photos, q(e.photos)) + (e.day ? `, ${t.taken(Oe(e.day))}` : "") : t.checkVideo,
		e.photos && e.sides.length > 1 ? t.checkSides(e.sides.map((e) => `${e.name} (${q(e.photos)})`).join(", ")) : "",
		e.photos ? e.positions ? t.checkPositions(q(e.positions)) : t.checkNoPositions : "",
		e.lookedAt < e.photos ? t.checkOf(q(e.lookedAt), q(e.photos)) : ""
	];
	return /* @__PURE__ */ X("div", {
		class: "check",
		role: "status",
		children: [
			e.photos > 0 && !e.problems.length && !e.warnings.length && /* @__PURE__ */ X("p", {
				class: "good",
				children: ["✓ ", t.checkGood]
			}),
			/* @__PURE__ */ X("p", {
				class: "soft",
				children: r.filter(Boolean).join(" · ")
			}),
			n.map((n) => {
				let r = e.problems.filter((e) => e.kind === n).map((e) => e.photo);
				return r.length > 0 && /* @__PURE__ */ X("div", {
					class: "warning",
					children: [
						/* @__PURE__ */ X("strong", { children: [
							t.problems[n],
							": ",
							t.photos(r.length, q(r.length))
						] }),
						/* @__PURE__ */ X("p", { children: t.problemDo[n] }),
						/* @__PURE__ */ X("p", {
							class: "soft names",
							children: r.slice(0, 12).join(", ") + (r.length > 12 ? " …" : "")
						})
					]
				}, n);
			}),
			e.warnings.map((e) => /* @__PURE__ */ X("p", {
				class: "warning",
				children: /* @__PURE__ */ X(ze, { text: e })
			}, e))
		]
	});
}
function ut({ kind: e }) {
	let t = K(), n = e === "markers" ? [
		30,
		95,
		160
	] : e === "scale-bar" ? [70, 120] : [];
	return /* @__PURE__ */ X("svg", {
		class: "picture-of",
		viewBox: "0 0 190 70",
		role: "img",
		"aria-label": n.length ? t.markersPicture : t.metresKinds[e],
		children: [
			/* @__PURE__ */ X("path", {
				d: "M0 62H190",
				class: "ground"
			}),
			[
				20,
				62,
				104,
				146
			].map((e) => /* @__PURE__ */ X("g", { children: [
				/* @__PURE__ */ X("path", {
					d: `M${e + 12} 62V34`,
					class: "trunk"
				}),
				/* @__PURE__ */ X("circle", {
					cx: e + 12,
					cy: "24",
					r: "17",
					class: "crown"
				}),
				/* @__PURE__ */ X("circle", {
					cx: e + 6,
					cy: "20",
					r: "3",
					class: "apple"
				}),
				/* @__PURE__ */ X("circle", {
					cx: e + 17,
					cy: "27",
					r: "3",
					class: "apple"
				})
			] }, e)),
			n.map((e) => /* @__PURE__ */ X("g", { children: [
				/* @__PURE__ */ X("rect", {
					x: e - 6,
					y: "44",
					width: "12",
					height: "12",
					class: "marker"
				}),
				/* @__PURE__ */ X("path", {
					d: `M${e - 3} 47h4v4h-4zM${e + 1} 51h3v3h-3z`,
					class: "code"
				}),
				/* @__PURE__ */ X("path", {
					d: `M${e} 56V62`,
					class: "trunk"
				})
			] }, e)),
			e === "scale-bar" && /* @__PURE__ */ X("path", {
				d: "M76 50H114",
				class: "bar"
			}),
			e === "gnss" && /* @__PURE__ */ X("path", {
				d: "M150 8l8 4-8 4zM158 12h14",
				class: "bar"
			})
		]
	});
}
function dt({ facts: e }) {
	let t = K(), [n, r] = U([]), [i, a] = U(""), [o, s] = U(null), [c, l] = U(0), [u, d] = U([]), [f, p] = U(!1), [m, h] = U(null), [g, _] = U(!1), [v, y] = U(""), [b, x] = U(!1), [S, C] = U(""), [w, T] = U(""), [E, D] = U("gnss"), [O, k] = U(""), [A, j] = U([
		"0",
		"1",
		""
	]), [M, N] = U(""), [P, ee] = U(!1), [F, I] = U(""), [L, te] = U(null), [ne, R] = U(""), z = G(null), re = G(Promise.resolve()), ie = ot(w, "mm"), B = ot(M, "m"), ae = E === "scale-bar" ? A.map((e, t) => ot(e, t === 2 ? "m" : "")) : [], V = [
		w,
		M,
		...A
	].filter((e, t) => Number.isNaN([
		ie,
		B,
		...ae
	][t])), H = {
		name: F.trim(),
		photos: n,
		oneSide: b,
		fruit: S,
		diameterMm: ie,
		metres: E,
		markers: E === "markers" ? O : "",
		scaleBar: ae.filter((e) => e !== null),
		treeSpacingM: B,
		learn: P
	};
	W(() => {
		if (!n.length) {
			h(null);
			return;
		}
		let e = !0;
		return _(!0), y(""), Y("check", {
			photos: n,
			oneSide: b
		}).then((t) => e && h(t)).catch((t) => {
			e && (h(null), y(t.message));
		}).finally(() => e && _(!1)), () => void (e = !1);
	}, [n.join("\n"), b]), W(() => {
		if (te(null), R(""), !n.length || !H.name || V.length) return;
		let e = setTimeout(() => {
			Y("equal", H).then(te, (e) => R(e.message));
		}, 300);
		return () => clearTimeout(e);
	}, [JSON.stringify(H), V.join("\n")]);
	let oe = (e) => r((t) => t.length === 1 && t[0] !== e ? [...t, e] : [e]), se = (e) => {
		a(""), i === "table" ? k(e) : (oe(e), F || I(ct(e).replace(/\.[^.]+$/, "")));
	}, ce = async (e) => {
		y(""), s({
			done: 0,
			files: e.length,
			bytes: 0,
			all: 1
		});
		try {
			oe(await at(e, (t, n, r) => s({
				done: t,
				files: e.length,
				bytes: n,
				all: r
			})));
		} catch (e) {
			y(e.message);
		}
		s(null);
	}, le = (e) => {
		let t = rt(e.filter((e) => $e(e.name))), n = it(t);
		l(e.length - n.length), d(n.filter(({ name: e }, n) => e !== t[n].name)), n.length && (re.current = re.current.then(() => ce(n)));
	}, ue = ({ currentTarget: e }) => {
		le(nt(e.files)), e.value = "";
	}, de = async () => {
		R("");
		try {
			Ue(`/survey/${await Y("surveys", H)}`);
		} catch (e) {
			R(e.message);
		}
	}, fe = e.fruits.find((e) => e.name === S)?.diameterMm ?? e.fruits[0].diameterMm;
	return /* @__PURE__ */ X("main", { children: [
		/* @__PURE__ */ X("div", {
			class: "head",
			children: /* @__PURE__ */ X("h1", { children: t.newSurvey })
		}),
		/* @__PURE__ */ X("section", {
			class: "sheet",
			"aria-labelledby": "step-photos",
			children: [
				/* @__PURE__ */ X("h2", {
					id: "step-photos",
					children: ["1. ", t.step1]
				}),
				/* @__PURE__ */ X("div", {
					class: `drop ${f ? "over" : ""}`,
					onDragOver: (e) => {
						e.preventDefault(), p(!0);
					},
					onDragLeave: () => p(!1),
					onDrop: (e) => {
						e.preventDefault(), p(!1), e.dataTransfer && tt(e.dataTransfer).then(le, (e) => y(e.message));
					},
					children: [/* @__PURE__ */ X("p", {
						class: "line",
						children: [/* @__PURE__ */ X("button", {
							type: "button",
							class: "main",
							onClick: () => a("photos"),
							children: n.length === 1 ? t.secondSide : t.chooseFolder
						}), /* @__PURE__ */ X("span", {
							class: "soft",
							children: t.chooseText
						})]
					}), /* @__PURE__ */ X("p", {
						class: "line",
						children: [
							/* @__PURE__ */ X("button", {
								type: "button",
								onClick: () => z.current?.click(),
								children: t.chooseFiles
							}),
							/* @__PURE__ */ X("span", {
								class: "soft",
								children: [
									t.dropHere,
									". ",
									t.dropText
								]
							}),
							/* @__PURE__ */ X("input", {
								ref: z,
								type: "file",
								multiple: !0,
								hidden: !0,
								"aria-label": t.chooseFiles,
								onChange: ue
							})
						]
					})]
				}),
				o && /* @__PURE__ */ X("p", {
					role: "status",
					children: [
						/* @__PURE__ */ X("progress", {
							value: o.bytes,
							max: o.all,
							"aria-label": t.copying(q(o.done), q(o.files))
						}),
						" ",
						t.copying(q(o.done), q(o.files))
					]
				}),
				c > 0 && /* @__PURE__ */ X("p", {
					class: "soft",
					children: t.skipped(c)
				}),
				u.length > 0 && /* @__PURE__ */ X("p", {
					class: "soft",
					children: t.renamed(u.length, u[0].file.name, u[0].name)
				}),
				n.length > 0 && /* @__PURE__ */ X("ul", {
					class: "chosen",
					"aria-label": t.chosen,
					children: n.map((e) => /* @__PURE__ */ X("li", { children: [/* @__PURE__ */ X("span", {
						class: "path",
						children: e
					}), /* @__PURE__ */ X("button", {
						type: "button",
						"aria-label": `${t.remove}: ${e}`,
						onClick: () => r(n.filter((t) => t !== e)),
						children: t.remove
					})] }, e))
				}),
				g && /* @__PURE__ */ X("p", {
					role: "status",
					children: [
						/* @__PURE__ */ X("progress", { "aria-label": t.checking }),
						" ",
						t.checking
					]
				}),
				v && /* @__PURE__ */ X(Z, { text: v }),
				m && !g && /* @__PURE__ */ X(lt, { check: m })
			]
		}),
		/* @__PURE__ */ X("section", {
			class: "sheet",
			"aria-labelledby": "step-known",
			children: [
				/* @__PURE__ */ X("h2", {
					id: "step-known",
					children: ["2. ", t.step2]
				}),
				/* @__PURE__ */ X("div", {
					class: "fields",
					children: [
						/* @__PURE__ */ X("label", { children: [
							t.fruit,
							/* @__PURE__ */ X("select", {
								value: S,
								onChange: (e) => C(e.currentTarget.value),
								children: [/* @__PURE__ */ X("option", {
									value: "",
									children: t.fruitOther
								}), e.fruits.map((e) => /* @__PURE__ */ X("option", {
									value: e.name,
									children: t.fruitNames[e.name] ?? e.name
								}, e.name))]
							}),
							/* @__PURE__ */ X("span", {
								class: "soft",
								children: t.fruitText
							})
						] }),
						/* @__PURE__ */ X("label", { children: [
							t.size,
							/* @__PURE__ */ X("input", {
								inputMode: "decimal",
								value: w,
								placeholder: q(fe),
								onInput: (e) => T(e.currentTarget.value)
							}),
							/* @__PURE__ */ X("span", {
								class: "soft",
								children: t.sizeText(q(fe))
							})
						] }),
						/* @__PURE__ */ X("label", { children: [t.sides, /* @__PURE__ */ X("select", {
							value: b ? "one" : "auto",
							onChange: (e) => x(e.currentTarget.value === "one"),
							children: [/* @__PURE__ */ X("option", {
								value: "auto",
								children: t.sidesAuto
							}), /* @__PURE__ */ X("option", {
								value: "one",
								children: t.sidesOne
							})]
						})] }),
						/* @__PURE__ */ X("label", { children: [
							t.spacing,
							/* @__PURE__ */ X("input", {
								inputMode: "decimal",
								value: M,
								onInput: (e) => N(e.currentTarget.value)
							}),
							/* @__PURE__ */ X("span", {
								class: "soft",
								children: t.spacingText
							})
						] })
					]
				}),
				/* @__PURE__ */ X("fieldset", { children: [
					/* @__PURE__ */ X("legend", { children: t.metres }),
					/* @__PURE__ */ X("div", {
						class: "kinds",
						children: st.map((e) => /* @__PURE__ */ X("label", {
							class: `kind ${E === e ? "on" : ""}`,
							children: [
								/* @__PURE__ */ X("span", {
									class: "line",
									children: [/* @__PURE__ */ X("input", {
										type: "radio",
										name: "metres",
										checked: E === e,
										onChange: () => D(e)
									}), /* @__PURE__ */ X("strong", { children: t.metresKinds[e] })]
								}),
								/* @__PURE__ */ X(ut, { kind: e }),
								/* @__PURE__ */ X("span", {
									class: "soft",
									children: t.metresText[e]
								})
							]
						}, e))
					}),
					E === "markers" && /* @__PURE__ */ X("p", {
						class: "line",
						children: [/* @__PURE__ */ X("button", {
							type: "button",
							onClick: () => a("table"),
							children: [t.markersFile, "…"]
						}), /* @__PURE__ */ X("span", {
							class: "path",
							children: O
						})]
					}),
					E === "scale-bar" && /* @__PURE__ */ X("div", {
						class: "fields",
						children: [
							t.barOne,
							t.barOther,
							t.barLength
						].map((e, t) => /* @__PURE__ */ X("label", { children: [e, /* @__PURE__ */ X("input", {
							inputMode: "decimal",
							value: A[t],
							onInput: (e) => j(A.map((n, r) => r === t ? e.currentTarget.value : n))
						})] }, e))
					})
				] }),
				e.canLearn && /* @__PURE__ */ X("label", {
					class: "line",
					children: [/* @__PURE__ */ X("input", {
						type: "checkbox",
						checked: P,
						onChange: (e) => ee(e.currentTarget.checked)
					}), /* @__PURE__ */ X("span", { children: [
						t.learnToo,
						" ",
						/* @__PURE__ */ X("span", {
							class: "soft",
							children: t.learnTooText
						})
					] })]
				})
			]
		}),
		/* @__PURE__ */ X("section", {
			class: "sheet",
			"aria-labelledby": "step-start",
			children: [
				/* @__PURE__ */ X("h2", {
					id: "step-start",
					children: ["3. ", t.step3]
				}),
				/* @__PURE__ */ X("div", {
					class: "fields",
					children: /* @__PURE__ */ X("label", { children: [
						t.name,
						/* @__PURE__ */ X("input", {
							value: F,
							placeholder: t.namePlaceholder,
							maxLength: 100,
							onInput: (e) => I(e.currentTarget.value)
						}),
						/* @__PURE__ */ X("span", {
							class: "soft path",
							children: t.nameText(`${e.surveysFolder}/${Ye(F)}`)
						})
					] })
				}),
				V.map((e) => /* @__PURE__ */ X(Z, { text: t.noNumber(e) }, e)),
				ne && /* @__PURE__ */ X(Z, { text: ne }),
				/* @__PURE__ */ X("p", {
					class: "line",
					children: [/* @__PURE__ */ X("button", {
						type: "button",
						class: "main",
						disabled: !n.length || !F.trim() || o !== null || V.length > 0,
						onClick: de,
						children: t.start
					}), /* @__PURE__ */ X("a", {
						class: "button",
						href: "#/",
						children: t.cancel
					})]
				}),
				L && /* @__PURE__ */ X("details", { children: [
					/* @__PURE__ */ X("summary", { children: t.equal }),
					/* @__PURE__ */ X("h3", { children: t.equalCommand }),
					/* @__PURE__ */ X($, { text: L.command }),
					/* @__PURE__ */ X("h3", { children: t.equalPython }),
					/* @__PURE__ */ X($, { text: L.python })
				] })
			]
		}),
		i && /* @__PURE__ */ X(He, {
			title: i === "photos" ? t.chooseFolder : t.markersFile,
			kind: i,
			start: n[0]?.replace(/[/\\][^/\\]*$/, "") || e.home,
			roots: e.roots,
			onClose: () => a(""),
			onChoose: se
		})
	] });
}
// src/app/scene.tsx
function ft(e) {
	let t = e.length / 3, n = [
		0,
		1,
		2
	].map((n) => {
		let r = 0;
		for (let t = n; t < e.length; t += 3) r += e[t];
		return r / t;
	}), r = 0;
	for (let t = 0; t < e.length; t += 3) r = Math.max(r, Math.hypot(e[t] - n[0], e[t + 1] - n[1], e[t + 2] - n[2]));
	return [n, r || 1];
}
function pt(e, t, n) {
	let r = e.getBoundingClientRect(), i = window.devicePixelRatio || 1;
	e.width = Math.round(r.width * i), e.height = Math.round(r.height * i);
	let a = e.getContext("2d");
	if (!a || !r.width) return;
	let [o, s] = ft(t.cameras), c = .42 * n.zoom * Math.min(r.width, 1.5 * r.height) * i / s, [l, u, d, f] = [
		Math.cos(n.turn),
		Math.sin(n.turn),
		Math.cos(n.tilt),
		Math.sin(n.tilt)
	], p = (t, n) => {
		let [r, i, a] = [
			t[n] - o[0],
			t[n + 1] - o[1],
			t[n + 2] - o[2]
		];
		return [e.width / 2 + (l * r + u * i) * c, e.height / 2 - (f * (l * i - u * r) + d * a) * c];
	}, m = (t) => (e.style.color = `var(--${t})`, getComputedStyle(e).color);
	for (let e = 0; e < t.points.length; e += 3) {
		let [n, r] = p(t.points, e);
		a.fillStyle = `#${t.colours[e / 3].toString(16).padStart(6, "0")}`, a.fillRect(n, r, 1.8 * i, 1.8 * i);
	}
	a.fillStyle = m("fruit");
	for (let e = 0; e < t.fruits.length; e += 4) {
		let [n, r] = p(t.fruits, e);
		a.beginPath(), a.arc(n, r, Math.max(2.2 * i, t.fruits[e + 3] / 2 * c), 0, 7), a.fill();
	}
	a.fillStyle = m("camera");
	for (let e = 0; e < t.cameras.length; e += 3) {
		let [n, r] = p(t.cameras, e);
		a.fillRect(n - 3 * i, r - 2 * i, 6 * i, 4 * i);
	}
}
function mt({ survey: e }) {
	let t = K(), [n, r] = U(null), i = G({
		turn: 0,
		tilt: .35,
		zoom: 1
	}), a = G(null), o = () => a.current && n && pt(a.current, n, i.current);
	if (W(() => void J(`surveys/${e.id}/scene`).then(r, () => r(null)), [e.id, e.version]), W(() => {
		o();
		let e = new ResizeObserver(o);
		return a.current && e.observe(a.current), () => e.disconnect();
	}, [n]), !n || !n.cameras.length) return /* @__PURE__ */ X("p", {
		class: "soft",
		children: t.sceneWait
	});
	let s = (e, t) => {
		i.current = {
			...i.current,
			turn: i.current.turn + e,
			tilt: Math.min(1.57, Math.max(0, i.current.tilt + t))
		}, o();
	}, c = (e) => {
		i.current = {
			...i.current,
			zoom: Math.min(20, Math.max(.2, i.current.zoom * e))
		}, o();
	}, l = {
		ArrowLeft: [-.1, 0],
		ArrowRight: [.1, 0],
		ArrowUp: [0, .1],
		ArrowDown: [0, -.1]
	};
	return /* @__PURE__ */ X("figure", { children: [/* @__PURE__ */ X("canvas", {
		ref: a,
		class: "scene",
		tabIndex: 0,
		role: "img",
		"aria-label": t.sceneLabel,
		onPointerDown: (e) => e.currentTarget.setPointerCapture(e.pointerId),
		onPointerMove: (e) => e.buttons && s(e.movementX / 150, e.movementY / 150),
		onWheel: (e) => {
			e.preventDefault(), c(Math.exp(-e.deltaY / 500));
		},
		onKeyDown: (e) => {
			(e.key === "+" || e.key === "-") && c(e.key === "+" ? 1.2 : 1 / 1.2);
			let t = l[e.key];
			t && (e.preventDefault(), s(...t));
		}
	}), /* @__PURE__ */ X("figcaption", {
		class: "soft",
		children: t.sceneText(q(n.cameras.length / 3), q(n.fruits.length / 4))
	})] });
}
// src/app/marks.ts
var ht = 3;
function gt(e, [t, n], [r, i], [a, o]) {
	let [s, c, l, u] = [
		Math.min(t, r),
		Math.min(n, i),
		Math.max(t, r),
		Math.max(n, i)
	], d = null;
	if (e === "circle") {
		let [e, a, o] = [
			(t + r) / 2,
			(n + i) / 2,
			Math.hypot(r - t, i - n) / 2
		];
		d = [
			e,
			a,
			o
		].map(Ct), [s, c, l, u] = [
			e - o,
			a - o,
			e + o,
			a + o
		];
	}
	let f = [
		Math.max(0, s),
		Math.max(0, c),
		Math.min(a, l),
		Math.min(o, u)
	].map(Ct);
	return f[2] - f[0] < ht || f[3] - f[1] < ht ? null : {
		box: f,
		circle: d
	};
}
function _t(e, [t, n], r) {
	let [i, a] = [-1, r];
	return e.forEach(({ box: e, circle: r }, o) => {
		let s = r ? Math.abs(Math.hypot(t - r[0], n - r[1]) - r[2]) : vt(e, t, n);
		s <= a && ([i, a] = [o, s]);
	}), i;
}
function vt(e, t, n) {
	let [r, i, a, o] = [
		e[0] - t,
		e[1] - n,
		t - e[2],
		n - e[3]
	], s = [Math.max(r, a, 0), Math.max(i, o, 0)];
	return s[0] || s[1] ? Math.hypot(...s) : -Math.max(r, i, a, o);
}
function yt(e, t, n = e.complete) {
	return {
		marks: t,
		complete: n,
		before: [...e.before, {
			marks: e.marks,
			complete: e.complete
		}]
	};
}
function bt(e) {
	let t = e.before.at(-1);
	return t ? {
		...t,
		before: e.before.slice(0, -1)
	} : e;
}
function xt([e, t, n, r], i, [a, o], [s, c]) {
	let l = Math.min(Math.max(1 / i, s / 30 / n), Math.max(s / n, c / r));
	return St([
		a - (a - e) * l,
		o - (o - t) * l,
		n * l,
		r * l
	], [s, c]);
}
function St([e, t, n, r], [i, a]) {
	return [
		Math.min(Math.max(e, -n / 2), i - n / 2),
		Math.min(Math.max(t, -r / 2), a - r / 2),
		n,
		r
	];
}
function Ct(e) {
	return Math.round(e * 10) / 10;
}
// src/app/marking.tsx
var wt = 7, Tt = 12, Et = 4;
function Dt({ survey: e, index: t, photos: n, onPhoto: r, onClose: i }) {
	let a = K(), [o, s] = U(null), [c, l] = U({
		marks: [],
		complete: !1,
		before: []
	}), [u, d] = U("circle"), [f, p] = U(null), [m, h] = U(null), [g, _] = U(-1), [v, y] = U(!0), [b, x] = U([
		0,
		0,
		1,
		1
	]), [S, C] = U(""), w = G(null), T = G(null), E = G(Promise.resolve()), D = G(c), O = G(c), k = `surveys/${e}/photos/${t}`, A = G(k);
	if (A.current = k, W(() => {
		let e = !0;
		return s(null), p(null), _(-1), C(""), J(`${k}/marks`).then((t) => {
			e && (s(t), D.current = O.current = {
				marks: t.marks,
				complete: t.complete,
				before: []
			}, l(O.current), x([
				0,
				0,
				t.width,
				t.height
			]));
		}, (t) => e && C(t.message)), () => void (e = !1);
	}, [k]), W(() => {
		o && document.activeElement === document.body && w.current?.focus();
	}, [o]), !o) return /* @__PURE__ */ X(Be, {
		title: a.mark,
		onClose: i,
		children: S ? /* @__PURE__ */ X(Z, { text: S }) : /* @__PURE__ */ X("progress", { "aria-label": a.mark })
	});
	let j = [o.width, o.height], M = (e) => {
		l(e), _(-1), C(""), D.current = e;
		let t = {
			complete: e.complete,
			marks: e.marks
		};
		E.current = E.current.then(() => Y(`${k}/marks`, t)).then(() => {
			A.current === k && (O.current = e);
		}, (t) => {
			C(t.message), D.current === e && l(O.current);
		});
	}, N = (e) => {
		let t = new DOMPoint(e.clientX, e.clientY).matrixTransform(w.current.getScreenCTM().inverse());
		return [t.x, t.y];
	}, P = () => 1 / (w.current?.getScreenCTM()?.a || 1), ee = (e) => {
		if (f) {
			let t = gt(u, f, e, j);
			p(null), t && M(yt(c, [...c.marks, t]));
			return;
		}
		let t = _t(c.marks, e, wt * P());
		_(t), t < 0 && p(e);
	}, F = () => g >= 0 && M(yt(c, c.marks.filter((e, t) => t !== g))), I = () => c.before.length && M(bt(c)), L = (e, t = [b[0] + b[2] / 2, b[1] + b[3] / 2]) => x(xt(b, e, t, j)), te = () => void E.current.then(i), ne = (e) => {
		let t = {
			ArrowLeft: [-1, 0],
			ArrowRight: [1, 0],
			ArrowUp: [0, -1],
			ArrowDown: [0, 1]
		}[e.key], n = m ?? [b[0] + b[2] / 2, b[1] + b[3] / 2];
		if (t) {
			let r = (e.shiftKey ? 1 : Tt) * P();
			h([Math.min(Math.max(n[0] + t[0] * r, 0), j[0]), Math.min(Math.max(n[1] + t[1] * r, 0), j[1])]);
		} else if (e.key === "Enter" || e.key === " ") ee(n);
		else if (e.key === "+" || e.key === "-") L(e.key === "+" ? 1.4 : 1 / 1.4, n);
		else if (e.key === "Delete" || e.key === "Backspace") F();
		else if (e.key === "z" && (e.ctrlKey || e.metaKey)) I();
		else if (e.key === "Escape" && f) p(null);
		else return;
		e.preventDefault();
	}, R = 1.6 * P(), z = f && m ? gt(u, f, m, j) : null;
	return /* @__PURE__ */ X(Be, {
		title: a.photoOf(o.name, a.marksOf(c.marks.length, q(c.marks.length))),
		onClose: te,
		wide: !0,
		children: [
			/* @__PURE__ */ X("div", {
				class: "line tools",
				role: "toolbar",
				"aria-label": a.mark,
				children: [
					["circle", "box"].map((e) => /* @__PURE__ */ X("button", {
						type: "button",
						"aria-pressed": u === e,
						onClick: () => d(e),
						children: a.shapes[e]
					}, e)),
					/* @__PURE__ */ X("button", {
						type: "button",
						disabled: !c.before.length,
						onClick: I,
						children: a.undo
					}),
					/* @__PURE__ */ X("button", {
						type: "button",
						disabled: g < 0,
						onClick: F,
						children: a.deleteMark
					}),
					/* @__PURE__ */ X("button", {
						type: "button",
						"aria-label": a.nearer,
						onClick: () => L(1.5),
						children: "+"
					}),
					/* @__PURE__ */ X("button", {
						type: "button",
						"aria-label": a.farther,
						onClick: () => L(1 / 1.5),
						children: "−"
					}),
					/* @__PURE__ */ X("label", {
						class: "line",
						children: [
							/* @__PURE__ */ X("input", {
								type: "checkbox",
								checked: v,
								onChange: (e) => y(e.currentTarget.checked)
							}),
							" ",
							a.showFound
						]
					}),
					/* @__PURE__ */ X("span", {
						class: "end",
						children: [/* @__PURE__ */ X("button", {
							type: "button",
							disabled: t === 0,
							"aria-label": a.photoBefore,
							onClick: () => r(t - 1),
							children: "‹"
						}), /* @__PURE__ */ X("button", {
							type: "button",
							disabled: t === n - 1,
							"aria-label": a.photoAfter,
							onClick: () => r(t + 1),
							children: "›"
						})]
					})
				]
			}),
			S && /* @__PURE__ */ X(Z, { text: S }),
			/* @__PURE__ */ X("svg", {
				ref: w,
				class: "marking",
				tabindex: 0,
				role: "application",
				"aria-label": a.markLabel,
				viewBox: b.join(" "),
				onKeyDown: ne,
				onWheel: (e) => {
					e.preventDefault(), L(Math.exp(-e.deltaY / 400), N(e));
				},
				onPointerDown: (e) => {
					T.current = {
						x: e.clientX,
						y: e.clientY,
						view: b,
						moved: !1
					}, e.currentTarget.setPointerCapture(e.pointerId);
				},
				onPointerMove: (e) => {
					let t = T.current;
					if (h(N(e)), !t || !e.buttons) return;
					let [n, r] = [e.clientX - t.x, e.clientY - t.y];
					t.moved ||= Math.hypot(n, r) > Et, t.moved && x(St([
						t.view[0] - n * P(),
						t.view[1] - r * P(),
						t.view[2],
						t.view[3]
					], j));
				},
				onPointerUp: (e) => {
					T.current && !T.current.moved && ee(N(e)), T.current = null;
				},
				children: [
					/* @__PURE__ */ X("image", {
						href: `api/${k}/whole.jpg`,
						width: o.width,
						height: o.height,
						preserveAspectRatio: "none"
					}),
					v && Array.from({ length: o.found.length / 4 }, (e, t) => o.found.slice(4 * t, 4 * t + 4)).map(([e, t, n, r], i) => /* @__PURE__ */ X("rect", {
						class: "found",
						x: e,
						y: t,
						width: n - e,
						height: r - t,
						"stroke-width": R
					}, `found-${i}`)),
					[...c.marks, ...z ? [z] : []].map(({ box: e, circle: t }, n) => {
						let r = n === g ? "mark on" : n === c.marks.length ? "mark started" : "mark";
						return t ? /* @__PURE__ */ X("circle", {
							class: r,
							cx: t[0],
							cy: t[1],
							r: t[2],
							"stroke-width": 1.5 * R
						}, n) : /* @__PURE__ */ X("rect", {
							class: r,
							x: e[0],
							y: e[1],
							width: e[2] - e[0],
							height: e[3] - e[1],
							"stroke-width": 1.5 * R
						}, n);
					}),
					m && /* @__PURE__ */ X("path", {
						class: "cross",
						d: `M${m[0] - 9 * P()} ${m[1]}h${18 * P()}M${m[0]} ${m[1] - 9 * P()}v${18 * P()}`,
						"stroke-width": R
					})
				]
			}),
			/* @__PURE__ */ X("p", {
				class: "line",
				children: /* @__PURE__ */ X("label", {
					class: "line",
					children: [/* @__PURE__ */ X("input", {
						type: "checkbox",
						checked: c.complete,
						onChange: (e) => M(yt(c, c.marks, e.currentTarget.checked))
					}), /* @__PURE__ */ X("span", { children: [
						a.complete,
						" ",
						/* @__PURE__ */ X("span", {
							class: "soft",
							children: a.completeText
						})
					] })]
				})
			}),
			/* @__PURE__ */ X("p", {
				class: "soft",
				children: f ? a.markSecond[u] : a.markFirst[u]
			})
		]
	});
}
// src/app/teach.tsx
var Ot = 24;
function kt({ survey: e, learnt: t, photos: n }) {
	let r = K(), [i, a] = U(Math.floor(n.length / 4)), o = [
		[
			r.learntRows.f1,
			t.f1,
			(e) => q(e, 3)
		],
		[
			r.learntRows.byHand(q(t.byHand)),
			t.byHandF1,
			(e) => q(e, 3)
		],
		[
			r.learntRows.halves,
			t.halves,
			(e) => q(100 * e) + " %"
		],
		[
			r.learntRows.detections,
			t.detections,
			(e) => q(e)
		],
		[
			r.learntRows.fruits,
			t.fruits,
			(e) => q(e)
		]
	], s = n[i]?.name ?? "", c = (t) => `api/surveys/${e.id}/${t}/${i}/1280.jpg?${e.version}`;
	return /* @__PURE__ */ X("section", {
		class: "learnt",
		"aria-label": r.learntTitle,
		children: [
			/* @__PURE__ */ X("h3", { children: r.learntTitle }),
			/* @__PURE__ */ X("p", { children: t.kept ? r.learnt : r.learntNot }),
			/* @__PURE__ */ X("table", { children: [/* @__PURE__ */ X("thead", { children: /* @__PURE__ */ X("tr", { children: [
				/* @__PURE__ */ X("td", {}),
				/* @__PURE__ */ X("th", {
					scope: "col",
					children: r.before
				}),
				/* @__PURE__ */ X("th", {
					scope: "col",
					children: r.after
				})
			] }) }), /* @__PURE__ */ X("tbody", { children: o.filter(([, e]) => e.length === 2).map(([e, t, n]) => /* @__PURE__ */ X("tr", { children: [
				/* @__PURE__ */ X("th", {
					scope: "row",
					children: e
				}),
				/* @__PURE__ */ X("td", { children: n(t[0]) }),
				/* @__PURE__ */ X("td", { children: n(t[1]) })
			] }, e)) })] }),
			/* @__PURE__ */ X("p", {
				class: "soft",
				children: r.learntHonest
			}),
			t.kept && n.length > 0 && /* @__PURE__ */ X(y, { children: [/* @__PURE__ */ X("label", {
				class: "line",
				children: [r.photosTab, /* @__PURE__ */ X("select", {
					value: i,
					onChange: (e) => a(Number(e.currentTarget.value)),
					children: n.map((e, t) => /* @__PURE__ */ X("option", {
						value: t,
						children: e.name
					}, e.name))
				})]
			}), /* @__PURE__ */ X("div", {
				class: "pair",
				children: ["before", "photos"].map((e) => /* @__PURE__ */ X("figure", { children: [/* @__PURE__ */ X("img", {
					src: c(e),
					alt: `${s}, ${e === "before" ? r.before : r.after}`,
					loading: "lazy"
				}), /* @__PURE__ */ X("figcaption", {
					class: "soft",
					children: e === "before" ? r.before : r.after
				})] }, e))
			})] })
		]
	});
}
function At({ survey: e, canLearn: t, working: n }) {
	let r = K(), [i, a] = U([]), [o, s] = U(null), [c, l] = U(""), [u, d] = U(Ot), [f, p] = U(null);
	if (W(() => void J(`surveys/${e.id}/photos`).then(a, () => a([])), [e.id, e.version]), W(() => {
		f === null && J(`surveys/${e.id}/teaching`).then(s, (e) => l(e.message));
	}, [
		e.id,
		e.version,
		n,
		f === null
	]), !i.length) return /* @__PURE__ */ X("p", {
		class: "soft",
		children: r.photosWait
	});
	let m = new Map(o?.marks.map((e) => [e.photo, e])), h = [...m.values()].reduce((e, t) => e + t.marks, 0), g = [...m.values()].filter((e) => e.complete).length, _ = (e) => {
		let t = m.get(e);
		return t ? `${r.marksOf(t.marks, q(t.marks))}${t.complete ? ` · ${r.allMarked}` : ""}` : "";
	}, v = i.map((e, t) => [e, t]).sort((e, t) => Number(m.has(t[0].name)) - Number(m.has(e[0].name)));
	return /* @__PURE__ */ X(y, { children: [
		/* @__PURE__ */ X("p", { children: r.teachText }),
		c && /* @__PURE__ */ X(Z, { text: c }),
		o?.learnt && /* @__PURE__ */ X(kt, {
			survey: e,
			learnt: o.learnt,
			photos: i
		}),
		/* @__PURE__ */ X("h3", { children: r.mark }),
		/* @__PURE__ */ X("p", {
			class: "soft",
			children: r.teachHow
		}),
		/* @__PURE__ */ X("ul", {
			class: "photos",
			children: v.slice(0, u).map(([t, n]) => /* @__PURE__ */ X("li", { children: /* @__PURE__ */ X("button", {
				type: "button",
				class: m.has(t.name) ? "marked" : "",
				onClick: () => p(n),
				"aria-label": `${r.mark}: ${t.name} ${_(t.name)}`,
				children: [
					/* @__PURE__ */ X("img", {
						src: `api/surveys/${e.id}/photos/${n}/320.jpg?${t.found ?? ""}-${e.version}`,
						alt: "",
						loading: "lazy"
					}),
					/* @__PURE__ */ X("span", {
						class: "path",
						children: t.name
					}),
					/* @__PURE__ */ X("span", {
						class: "soft",
						children: _(t.name)
					})
				]
			}) }, t.name))
		}),
		i.length > u && /* @__PURE__ */ X("button", {
			type: "button",
			onClick: () => d(i.length),
			children: r.more(q(i.length - u))
		}),
		/* @__PURE__ */ X("h3", { children: r.learn }),
		/* @__PURE__ */ X("p", {
			role: "status",
			children: r.taught(r.marksOf(h, q(h)), r.photos(m.size, q(m.size)), q(g), q(o?.corrections ?? 0))
		}),
		/* @__PURE__ */ X("p", {
			class: "soft",
			children: r.learnText
		}),
		t ? /* @__PURE__ */ X(Q, {
			class: "main",
			disabled: n,
			onDo: () => Y(`surveys/${e.id}/learn`),
			children: r.learnFromThese
		}) : /* @__PURE__ */ X("p", {
			class: "warning",
			children: r.learnMissing
		}),
		o?.equal && /* @__PURE__ */ X("details", { children: [
			/* @__PURE__ */ X("summary", { children: r.equal }),
			/* @__PURE__ */ X("h3", { children: r.equalCommand }),
			/* @__PURE__ */ X($, { text: o.equal.command }),
			/* @__PURE__ */ X("h3", { children: r.equalPython }),
			/* @__PURE__ */ X($, { text: o.equal.python })
		] }),
		f !== null && /* @__PURE__ */ X(Dt, {
			survey: e.id,
			index: f,
			photos: i.length,
			onPhoto: p,
			onClose: () => p(null)
		})
	] });
}
// src/app/survey.tsx
var jt = [
	"queued",
	"running",
	"stopping"
], Mt = 24, Nt = [
	"report.html",
	"fruits.csv",
	"trees.csv",
	"gpkg",
	"fruits.geojson",
	"kml",
	"laz",
	"ply",
	"coco",
	"colmap",
	"nerfstudio",
	"metashape",
	"geoparquet"
];
function Pt({ survey: e }) {
	let t = K();
	if (e.run?.byOther) return /* @__PURE__ */ X("p", {
		class: "soft",
		children: t.byOther
	});
	let n = (t) => () => Y(`surveys/${e.id}/${t}`);
	if (e.state === "queued") return /* @__PURE__ */ X(Q, {
		onDo: n("stop"),
		children: t.unqueue
	});
	if (e.state === "running") return /* @__PURE__ */ X(Q, {
		onDo: n("stop"),
		children: t.stop
	});
	if (e.state === "stopping") return /* @__PURE__ */ X("span", {
		class: "line",
		children: [
			/* @__PURE__ */ X(Q, {
				onDo: n("stop"),
				children: t.stopNow
			}),
			" ",
			/* @__PURE__ */ X("span", {
				class: "soft",
				children: t.stoppingText
			})
		]
	});
	if (e.state === "missing") return /* @__PURE__ */ X("p", {
		class: "soft",
		children: t.missingText
	});
	let r = e.state === "finished";
	return /* @__PURE__ */ X(Q, {
		class: r ? "" : "main",
		onDo: n("go-on"),
		children: r ? t.again : t.goOn
	});
}
function Ft({ survey: e }) {
	let t = K(), n = e.run;
	if (!n) return null;
	let r = Ge(e), i = n.stages.find((e) => e.state === "now"), a = jt.includes(e.state);
	return /* @__PURE__ */ X("section", {
		class: "sheet",
		"aria-label": t.progress,
		children: [
			r !== null && /* @__PURE__ */ X("div", {
				class: "now",
				role: "status",
				children: [/* @__PURE__ */ X("span", {
					class: "line",
					children: [
						/* @__PURE__ */ X("strong", { children: i ? t.stages[i.name] ?? i.name : "" }),
						/* @__PURE__ */ X("span", {
							class: "soft",
							children: [
								Ae(n.label),
								" ",
								n.total ? t.of(q(n.done), q(n.total)) : ""
							]
						}),
						n.leftS !== null && /* @__PURE__ */ X("span", {
							class: "end",
							children: t.left(ke(n.leftS))
						})
					]
				}), /* @__PURE__ */ X("progress", {
					value: r,
					max: 1,
					"aria-label": t.progress
				})]
			}),
			/* @__PURE__ */ X("ol", {
				class: "stages",
				children: n.stages.map((e) => /* @__PURE__ */ X("li", {
					class: e.state,
					"aria-current": e === i && a ? "step" : void 0,
					children: [
						/* @__PURE__ */ X("span", {
							class: "name",
							children: t.stages[e.name] ?? e.name
						}),
						/* @__PURE__ */ X("span", {
							class: "soft",
							children: e.seconds === null ? "" : ke(e.seconds)
						}),
						/* @__PURE__ */ X("span", {
							class: "hidden",
							children: t.stageStates[e === i && !a ? "halted" : e.state]
						})
					]
				}, e.name))
			}),
			n.message && (e.state === "failed" || e.state === "stopped") && /* @__PURE__ */ X(y, { children: [/* @__PURE__ */ X(Z, {
				title: t.failed,
				text: n.message
			}), /* @__PURE__ */ X("p", {
				class: "soft",
				children: t.failedDo
			})] }),
			n.warnings.length > 0 && /* @__PURE__ */ X("div", {
				class: "warnings",
				children: [
					/* @__PURE__ */ X("h3", { children: t.warnings }),
					t.english && /* @__PURE__ */ X("p", {
						class: "soft",
						children: t.english
					}),
					/* @__PURE__ */ X("ul", { children: n.warnings.map((e) => /* @__PURE__ */ X("li", { children: /* @__PURE__ */ X(ze, { text: e }) }, e)) })
				]
			}),
			n.log.length > 0 && /* @__PURE__ */ X("details", { children: [/* @__PURE__ */ X("summary", { children: t.log }), /* @__PURE__ */ X("pre", {
				class: "log",
				tabIndex: 0,
				children: n.log.join("\n")
			})] })
		]
	});
}
function It({ survey: e }) {
	let t = K(), [n, r] = U([]), [i, a] = U(Mt), [o, s] = U(null), c = e.run?.stages.some((e) => e.name === "segment" && e.state === "now") ? e.run.done : 0;
	if (W(() => void J(`surveys/${e.id}/photos`).then(r, () => r([])), [
		e.id,
		e.version,
		c
	]), !n.length) return /* @__PURE__ */ X("p", {
		class: "soft",
		children: t.photosWait
	});
	let l = (n) => n.found === null ? e.fruits === null ? t.notYet : "" : t.possible(n.found, q(n.found)), u = (t, r) => `api/surveys/${e.id}/photos/${t}/${r}.jpg?${n[t].found ?? ""}-${e.version}`, d = o === null ? null : n[o];
	return /* @__PURE__ */ X(y, { children: [
		/* @__PURE__ */ X("ul", {
			class: "photos",
			children: n.slice(0, i).map((e, n) => /* @__PURE__ */ X("li", { children: /* @__PURE__ */ X("button", {
				type: "button",
				onClick: () => s(n),
				"aria-label": t.photoOf(e.name, l(e)),
				children: [
					/* @__PURE__ */ X("img", {
						src: u(n, 320),
						alt: "",
						loading: "lazy"
					}),
					/* @__PURE__ */ X("span", {
						class: "path",
						children: e.name
					}),
					/* @__PURE__ */ X("span", {
						class: "soft",
						children: l(e)
					})
				]
			}) }, e.name))
		}),
		n.length > i && /* @__PURE__ */ X("button", {
			type: "button",
			onClick: () => a(n.length),
			children: t.more(q(n.length - i))
		}),
		d && o !== null && /* @__PURE__ */ X(Be, {
			title: t.photoOf(d.name, l(d)),
			onClose: () => s(null),
			children: /* @__PURE__ */ X("img", {
				class: "large",
				src: u(o, 1280),
				alt: t.photoOf(d.name, l(d))
			})
		})
	] });
}
function Lt({ survey: e }) {
	let t = K(), [n, r] = U(null), [i, a] = U("");
	return W(() => void J(`surveys/${e.id}/trees`).then(r, (e) => a(e.message)), [e.id, e.version]), i ? /* @__PURE__ */ X(Z, { text: i }) : n ? n.length ? /* @__PURE__ */ X("div", {
		class: "scroll",
		tabIndex: 0,
		role: "region",
		"aria-label": t.treesTab,
		children: /* @__PURE__ */ X("table", { children: [/* @__PURE__ */ X("thead", { children: /* @__PURE__ */ X("tr", { children: [
			t.tree,
			t.fruitsHead,
			t.between,
			`${t.diameter} (mm)`,
			`${t.weight} (kg)`
		].map((e) => /* @__PURE__ */ X("th", {
			scope: "col",
			children: e
		}, e)) }) }), /* @__PURE__ */ X("tbody", { children: n.map((e) => /* @__PURE__ */ X("tr", { children: [
			/* @__PURE__ */ X("th", {
				scope: "row",
				children: e.id
			}),
			/* @__PURE__ */ X("td", { children: q(e.fruits) }),
			/* @__PURE__ */ X("td", { children: e.low === null || e.high === null ? "" : `${q(e.low)} – ${q(e.high)}` }),
			/* @__PURE__ */ X("td", { children: e.diameterMm === null ? "" : q(e.diameterMm, 1) }),
			/* @__PURE__ */ X("td", { children: e.weightKg === null ? "" : q(e.weightKg, 2) })
		] }, e.id)) })] })
	}) : /* @__PURE__ */ X("p", {
		class: "soft",
		children: t.noTrees
	}) : /* @__PURE__ */ X("progress", { "aria-label": t.treesTab });
}
function Rt({ survey: e, everything: t }) {
	let n = K(), r = t.surveys.filter((t) => t.id !== e.id && t.fruits !== null), [i, a] = U(r[0]?.id ?? ""), [o, s] = U(""), [c, l] = U(0), u = async () => {
		s(await Y(`surveys/${e.id}/compare`, { before: i })), l(c + 1);
	}, d = (e) => {
		a(e), s("");
	};
	return r.length ? /* @__PURE__ */ X(y, { children: [
		/* @__PURE__ */ X("p", {
			class: "soft",
			children: n.compareText
		}),
		/* @__PURE__ */ X("p", {
			class: "line",
			children: [/* @__PURE__ */ X("label", {
				class: "line",
				children: [n.compareWith, /* @__PURE__ */ X("select", {
					value: i,
					onChange: (e) => d(e.currentTarget.value),
					children: r.map((e) => /* @__PURE__ */ X("option", {
						value: e.id,
						children: e.name
					}, e.id))
				})]
			}), /* @__PURE__ */ X(Q, {
				class: "main",
				onDo: u,
				children: n.compare
			})]
		}),
		o && /* @__PURE__ */ X("iframe", {
			class: "view",
			src: o.slice(1),
			title: n.compareTab
		}, c)
	] }) : /* @__PURE__ */ X("p", {
		class: "soft",
		children: n.compareNone
	});
}
function zt({ survey: e, everything: t }) {
	let n = K(), r = Nt.filter((e) => e.includes(".") || t.facts.exports.includes(e));
	return /* @__PURE__ */ X(y, { children: [
		/* @__PURE__ */ X("h2", { children: n.files }),
		/* @__PURE__ */ X("ul", {
			class: "files",
			children: r.map((t) => /* @__PURE__ */ X("li", { children: /* @__PURE__ */ X(Q, {
				onDo: () => Pe(`surveys/${e.id}/files/${t}`),
				children: n.fileNames[t] ?? t
			}) }, t))
		}),
		/* @__PURE__ */ X("p", {
			class: "soft path",
			children: [
				n.folder,
				": ",
				e.folder
			]
		})
	] });
}
function Bt({ survey: e }) {
	let t = K(), [n, r] = U(null);
	return /* @__PURE__ */ X("details", {
		class: "sheet",
		onToggle: () => void J(`surveys/${e.id}/equal`).then(r, () => r(null)),
		children: [/* @__PURE__ */ X("summary", { children: t.equal }), n && /* @__PURE__ */ X(y, { children: [
			/* @__PURE__ */ X("h3", { children: t.equalCommand }),
			/* @__PURE__ */ X($, { text: n.command }),
			/* @__PURE__ */ X("h3", { children: t.equalPython }),
			/* @__PURE__ */ X($, { text: n.python })
		] })]
	});
}
var Vt = [
	"photos",
	"scene",
	"result",
	"trees",
	"compare",
	"teach",
	"files"
];
function Ht({ survey: e, everything: t, place: n }) {
	let r = K(), i = e.state === "finished", a = i || e.fruits !== null && ["stopped", "failed"].includes(e.state), o = Vt.find((e) => e === n) ?? (a ? "result" : e.fruits !== null || e.run?.stages.some((e) => e.name === "scale" && (e.state === "done" || e.state === "kept")) ? "scene" : "photos"), s = {
		photos: r.photosTab,
		scene: r.sceneTab,
		result: r.resultTab,
		trees: r.treesTab,
		compare: r.compareTab,
		teach: r.teachTab,
		files: r.exportTab
	};
	return /* @__PURE__ */ X("main", { children: [
		/* @__PURE__ */ X("div", {
			class: "head",
			children: [
				/* @__PURE__ */ X("a", {
					class: "button plain",
					href: "#/",
					"aria-label": r.back,
					children: "‹"
				}),
				/* @__PURE__ */ X("h1", { children: e.name }),
				/* @__PURE__ */ X("span", {
					class: `state ${e.state}`,
					children: r.states[e.state]
				}),
				/* @__PURE__ */ X("span", {
					class: "end",
					children: /* @__PURE__ */ X(Pt, { survey: e })
				})
			]
		}),
		/* @__PURE__ */ X("p", {
			class: "soft",
			children: [
				We(e),
				e.weightKg === null ? "" : `${q(e.weightKg, 1)} kg`,
				e.corrected ? r.corrected : "",
				e.photos === null ? "" : r.photos(e.photos, q(e.photos)),
				e.day ? r.taken(Oe(e.day)) : ""
			].filter(Boolean).join(" · ")
		}),
		!i && /* @__PURE__ */ X(Ft, { survey: e }),
		/* @__PURE__ */ X("section", {
			class: "sheet results",
			children: [/* @__PURE__ */ X("div", {
				class: "tabs",
				role: "tablist",
				children: Vt.map((t) => /* @__PURE__ */ X("a", {
					role: "tab",
					id: `tab-${t}`,
					"aria-selected": o === t,
					"aria-controls": "panel",
					href: `#/survey/${e.id}/${t}`,
					tabIndex: o === t ? 0 : -1,
					onKeyDown: (n) => {
						let r = n.key === "ArrowRight" ? 1 : n.key === "ArrowLeft" ? -1 : 0;
						if (!r) return;
						let i = Vt[(Vt.indexOf(t) + r + Vt.length) % Vt.length];
						Ue(`/survey/${e.id}/${i}`), document.getElementById(`tab-${i}`)?.focus();
					},
					children: s[t]
				}, t))
			}), /* @__PURE__ */ X("div", {
				id: "panel",
				role: "tabpanel",
				"aria-labelledby": `tab-${o}`,
				children: o === "photos" ? /* @__PURE__ */ X(It, { survey: e }) : o === "scene" ? /* @__PURE__ */ X(mt, { survey: e }) : o === "teach" ? /* @__PURE__ */ X(At, {
					survey: e,
					canLearn: t.facts.canLearn,
					working: jt.includes(e.state) || !!e.run?.byOther
				}) : a ? o === "trees" ? /* @__PURE__ */ X(Lt, { survey: e }) : o === "compare" ? /* @__PURE__ */ X(Rt, {
					survey: e,
					everything: t
				}) : o === "files" ? /* @__PURE__ */ X(zt, {
					survey: e,
					everything: t
				}) : /* @__PURE__ */ X(y, { children: [/* @__PURE__ */ X("p", {
					class: "line",
					children: /* @__PURE__ */ X("button", {
						type: "button",
						class: "end",
						onClick: () => document.querySelector("iframe.view")?.contentWindow?.print(),
						children: r.print
					})
				}), /* @__PURE__ */ X("iframe", {
					class: "view",
					src: `surveys/${e.id}/view/`,
					title: r.viewTitle
				}, e.id)] }) : /* @__PURE__ */ X("p", {
					class: "soft",
					children: r.resultWait
				})
			})]
		}),
		i && /* @__PURE__ */ X(Ft, { survey: e }),
		e.photos !== null && /* @__PURE__ */ X(Bt, { survey: e }),
		!jt.includes(e.state) && /* @__PURE__ */ X("p", {
			class: "line",
			children: [/* @__PURE__ */ X(Q, {
				onDo: async () => {
					await Y(`surveys/${e.id}/forget`), Ue("/");
				},
				children: r.forget
			}), /* @__PURE__ */ X("span", {
				class: "soft",
				children: r.forgetText
			})]
		})
	] });
}
// src/app/main.tsx
function Ut() {
	let e = document.documentElement, t = e.dataset.theme ? e.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
	e.dataset.theme = t ? "light" : "dark";
}
function Wt() {
	let [e, t] = U(null), [n, r] = U("yes"), [i, a] = U(location.hash), [o, s] = U(Ee()), [c, l] = U(!1), [u, d] = U(!1);
	W(() => u ? void 0 : Le(t, r), [u]), W(() => {
		let e = () => a(location.hash);
		return addEventListener("hashchange", e), () => removeEventListener("hashchange", e);
	}, []), W(() => {
		document.documentElement.lang = o;
	}, [o]);
	let f = K();
	if (u) return /* @__PURE__ */ X("main", {
		class: "closed",
		children: [/* @__PURE__ */ X("h1", { children: f.closed }), /* @__PURE__ */ X("p", { children: f.closedHow })]
	});
	let [, p, m, h] = i.replace(/^#/, "").split("/"), g = e?.surveys.find((e) => e.id === m);
	return document.title = g ? `${g.name} · ${f.title}` : f.title, /* @__PURE__ */ X(y, { children: [
		/* @__PURE__ */ X("header", {
			class: "top",
			children: [/* @__PURE__ */ X("a", {
				href: "#/",
				class: "brand",
				children: [/* @__PURE__ */ X("svg", {
					viewBox: "0 0 16 16",
					"aria-hidden": "true",
					children: [/* @__PURE__ */ X("circle", {
						cx: "8",
						cy: "9",
						r: "6",
						fill: "#b8322a"
					}), /* @__PURE__ */ X("path", {
						d: "M8 4q0-3 3-3",
						fill: "none",
						stroke: "#4f7d5a",
						"stroke-width": "1.6"
					})]
				}), f.title]
			}), /* @__PURE__ */ X("span", {
				class: "end",
				children: [
					/* @__PURE__ */ X("select", {
						"aria-label": "Language, Sprache",
						value: o,
						onChange: (e) => {
							Te(e.currentTarget.value), s(e.currentTarget.value);
						},
						children: Object.entries(xe).map(([e, t]) => /* @__PURE__ */ X("option", {
							value: e,
							children: t.language
						}, e))
					}),
					/* @__PURE__ */ X("button", {
						type: "button",
						"aria-label": f.theme,
						title: f.theme,
						onClick: Ut,
						children: /* @__PURE__ */ X("svg", {
							viewBox: "0 0 16 16",
							"aria-hidden": "true",
							children: [/* @__PURE__ */ X("path", {
								d: "M8 2a6 6 0 1 0 0 12z",
								fill: "currentColor"
							}), /* @__PURE__ */ X("circle", {
								cx: "8",
								cy: "8",
								r: "6",
								fill: "none",
								stroke: "currentColor"
							})]
						})
					}),
					/* @__PURE__ */ X("button", {
						type: "button",
						onClick: () => l(!0),
						children: f.close
					})
				]
			})]
		}),
		n !== "yes" && /* @__PURE__ */ X("p", {
			class: "lost",
			role: "alert",
			children: n === "no" ? f.lost : f.ended
		}),
		e ? p === "new" ? /* @__PURE__ */ X(dt, { facts: e.facts }) : p === "survey" && g ? /* @__PURE__ */ X(Ht, {
			survey: g,
			everything: e,
			place: h ?? ""
		}, g.id) : /* @__PURE__ */ X(qe, { everything: e }) : /* @__PURE__ */ X("main", { children: /* @__PURE__ */ X("progress", { "aria-label": f.surveys }) }),
		c && /* @__PURE__ */ X(Be, {
			title: f.close,
			onClose: () => l(!1),
			children: [/* @__PURE__ */ X("p", { children: f.closeSure }), /* @__PURE__ */ X("p", {
				class: "line",
				children: [/* @__PURE__ */ X(Q, {
					class: "main",
					onDo: async () => {
						await Y("close"), d(!0);
					},
					children: f.close
				}), /* @__PURE__ */ X("button", {
					type: "button",
					onClick: () => l(!1),
					children: f.cancel
				})]
			})]
		})
	] });
}
ne(/* @__PURE__ */ X(Wt, {}), document.getElementById("app"));
